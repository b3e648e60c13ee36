"""Evaluate: how well estimators and orders predict measurements, of the history or given."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, InvalidInputError, refuse_reversed
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.history import UNOBSERVED, History
from tidemap.services.context import Context
from tidemap.services.history import read_history, window
from tidemap.services.horizons import HorizonQuery, HorizonScores, evaluate_horizons
from tidemap.services.parts import seen_chunks
from tidemap.services.spectra import current_revision, recipe_for
from tidemap.spectral.estimators import fit_all
from tidemap.spectral.evaluation import Reliability, Scores, ScoreSums
from tidemap.spectral.spectrum import Spectrum
from tidemap.spectral.window import chosen_window
from tidemap.storage.records import LocationRecord, RevisionRecord

MAX_VALUES = 20_000_000
"""Predictions that one evaluation makes of many cells; of larger locations evenly spread cells are scored."""
MAX_CELL_VALUES = 100_000_000
"""Predictions that one evaluation makes of one cell; more are refused."""
DEFAULT_ESTIMATORS = ("fft", "calendar", "static")


Candidate = tuple[str, int]
"""Estimator and order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateQuery:
    """What to score, against the history in [start, stop) or measurements given; None: the revision's own choice.

    Each candidate is fitted on the window of the current revision, or on [train_start, train_stop). Horizons are scored
    as a `HorizonQuery` says, and without orders nothing else is.
    """

    orders: Sequence[int] = ()
    horizons_s: Sequence[float] = ()
    estimators: Sequence[str] | None = None
    start: float | None = None
    stop: float | None = None
    confidence: float | None = None
    time: Sequence[float] | None = None
    state: Sequence[int] | None = None
    train_start: float | None = None
    train_stop: float | None = None


@dataclass(frozen=True, slots=True)
class ScoredCandidate:
    """An estimator and order with their scores."""

    estimator: str
    order: int
    scores: Scores


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All candidates, the one with the least log loss, and how reliable that one is; None where none were asked for.

    horizons: in the order in which they were asked for.
    """

    candidates: list[ScoredCandidate]
    best: ScoredCandidate | None
    reliability: Reliability | None
    revision: int
    horizons: list[HorizonScores]


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """What some cells showed (n_cells, n_times) and the fits to be scored on it."""

    time: NDArray[np.float64]
    states: NDArray[np.uint8]
    spectra: dict[Candidate, Spectrum]


def evaluate(ctx: Context, name: str, query: EvaluateQuery, check: Callable[[], None] = lambda: None) -> Comparison:
    """Scores per estimator and order; the spectra are fitted on the revision's window or the one asked for. By horizon
    the answer given what was read.

    Chunks that are damaged are left out. `check` is called between blocks; what it raises ends the evaluation.
    Raises LocationNotFoundError, NoModelError, InvalidInputError, CorruptChunkError where there is one chunk only.
    """
    refuse_reversed(query.start, query.stop)
    _check_asked(query)
    location, revision = current_revision(ctx, name)
    comparison = Comparison([], None, None, revision.revision, [])
    if query.orders:
        comparison = _compared(ctx, location, revision, query, check)
    if query.horizons_s:
        walked = HorizonQuery(query.horizons_s, query.start, query.stop, query.train_start)
        comparison = replace(comparison, horizons=evaluate_horizons(ctx, location, walked, check))
    return comparison


def _check_asked(query: EvaluateQuery) -> None:
    if not query.orders and (query.estimators or not query.horizons_s):
        raise InvalidInputError.at("orders", "they are missing; give orders to compare, or horizons_s, or both")
    if query.horizons_s and (query.time is not None or query.state is not None):
        raise InvalidInputError.at("horizons_s", "horizons are scored against the history; leave time and state out")
    if query.horizons_s and query.train_stop is not None:
        raise InvalidInputError.at("train_stop", "for horizons all before is learned from; leave train_stop out")


def _compared(
    ctx: Context, location: LocationRecord, revision: RevisionRecord, query: EvaluateQuery, check: Callable[[], None]
) -> Comparison:
    """Scores of every estimator and order."""
    train = _training(ctx, location, revision, query)
    candidates = _candidates(query)
    tallies = {candidate: ScoreSums(query.confidence) for candidate in candidates}
    observed = 0
    for trial in _trials(ctx, location, train, query, candidates, check):
        observed += int((trial.states != UNOBSERVED).sum())
        for candidate, spectrum in trial.spectra.items():
            tallies[candidate].add_predicted(spectrum, trial.time, trial.states, check)
    if not observed:
        raise InvalidInputError.at("start", "nothing was observed in this time; choose another range")
    return _answer(tallies, revision.revision)


def _candidates(query: EvaluateQuery) -> list[Candidate]:
    for i, order in enumerate(query.orders):
        if not 0 <= order <= 64:
            raise InvalidInputError.at(f"orders[{i}]", "an order is 0 to 64")
    names = dict.fromkeys(query.estimators or DEFAULT_ESTIMATORS)
    orders = dict.fromkeys(query.orders)
    return [(name, order) for name in names for order in ((0,) if name == "static" else orders)]


def _training(ctx: Context, location: LocationRecord, revision: RevisionRecord, query: EvaluateQuery) -> RevisionRecord:
    own = (revision.start, revision.stop)
    start, stop = chosen_window(location.base, window(ctx, location), own, (query.train_start, query.train_stop))
    if stop <= start:
        raise InvalidInputError.at("train_stop", "the training window is empty; widen it")
    return replace(revision, start=start, stop=stop)


def _trials(
    ctx: Context,
    location: LocationRecord,
    train: RevisionRecord,
    query: EvaluateQuery,
    candidates: list[Candidate],
    check: Callable[[], None],
) -> Iterator[_Trial]:
    recipes = {candidate: recipe_for(location, train, *candidate) for candidate in candidates}

    def trial(history: History, time: NDArray[np.float64], states: NDArray[np.uint8]) -> _Trial:
        return _Trial(time, states, fit_all(history, recipes, location.base, check))

    if query.time is not None or query.state is not None:
        time, given = _given(location, query)
        _check_size(len(time), candidates)
        yield trial(read_history(ctx, location, 0, train.start, train.stop), time, given)
        return
    start, stop = _tested(ctx, location, query)
    _check_size(stop - start, candidates)
    chunks = seen_chunks(ctx, location).tolist()
    n_cells = min(location.n_cells, len(chunks) * CHUNK_CELLS)
    step = max(1, n_cells * (stop - start) * len(candidates) // MAX_VALUES)
    for chunk in chunks:
        cells = np.arange(chunk % step, location.chunk_size(chunk), step)
        try:
            states = read_history(ctx, location, chunk, start, stop).cells(cells).states()
            past = read_history(ctx, location, chunk, train.start, train.stop).cells(cells)
        except CorruptChunkError:
            if location.n_chunks == 1:
                raise
            continue
        yield trial(past, location.base.time(np.arange(start, stop)), states)


def _check_size(n_times: int, candidates: list[Candidate]) -> None:
    """Refuse what would take minutes, before it begins."""
    if n_times * len(candidates) > MAX_CELL_VALUES:
        raise InvalidInputError.at(
            "orders",
            f"{n_times} times by {len(candidates)} estimators and orders are more than {MAX_CELL_VALUES} predictions; "
            "evaluate a shorter time or fewer orders",
        )


def _given(location: LocationRecord, query: EvaluateQuery) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    if location.grid is not None:
        raise InvalidInputError.at(
            "time", "measurements can be given for kind 'state' only; post them and use start, stop"
        )
    if query.time is None or query.state is None or len(query.time) != len(query.state):
        raise InvalidInputError.at("state", "time and state must both be given and be of one length")
    time, state = np.asarray(query.time, np.float64), np.asarray(query.state, np.uint8)
    inside = np.ones(len(time), bool)
    if query.start is not None:
        inside &= time >= query.start
    if query.stop is not None:
        inside &= time < query.stop
    return time[inside], state[inside][np.newaxis, :]


def _tested(ctx: Context, location: LocationRecord, query: EvaluateQuery) -> tuple[int, int]:
    start, stop = location.base.clamp(window(ctx, location), query.start, query.stop)
    if stop <= start:
        raise InvalidInputError.at("stop", "nothing was observed between start and stop; widen the range")
    return start, stop


def _answer(tallies: dict[Candidate, ScoreSums], revision: int) -> Comparison:
    scored = [ScoredCandidate(*candidate, tally.scores()) for candidate, tally in tallies.items() if tally.n]
    if not scored:
        raise InvalidInputError.at("start", "no cell observed then was observed in the training window")
    best = min(scored, key=lambda each: each.scores.log_loss)
    return Comparison(scored, best, tallies[best.estimator, best.order].reliability(), revision, [])
