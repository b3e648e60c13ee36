"""Horizons: a location's answers given what was read some time before, scored by a walk through its history."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from tidemap.errors import InvalidInputError
from tidemap.history.history import History
from tidemap.services.context import Context
from tidemap.services.history import read_history, read_measured, window
from tidemap.services.sampling import SampledCells, measured, sample_cells
from tidemap.services.selection import selected, settled
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.evaluation import Reliability, Scores, ScoreSums, expected_calibration_error
from tidemap.spectral.horizons import Erring, HorizonSums, WalkPlan, walk
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.sensor import Sensor
from tidemap.storage.records import LocationRecord

MAX_HORIZON_S = 366 * DAY_S
MAX_REFITS = 8
"""How often a walk learns anew; not more often than daily."""
MAX_PREDICTIONS = 20_000_000
"""Of one walk, over cells, samples and horizons; of larger ones fewer cells are scored, of one cell more is refused."""
SCORED_CELLS = 16
"""Changing cells that are scored, or up to four times as many."""
PAST_SHARE = 0.75
"""The part of the history that is learned from where no start is given."""


@dataclass(frozen=True, slots=True)
class HorizonQuery:
    """What is scored: readings in [start, stop), by default the last quarter of the history.

    train_start: nothing before it is learned from, nor read last.
    """

    horizons_s: Sequence[float]
    start: float | None = None
    stop: float | None = None
    train_start: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScoredAnswers:
    """How one kind of answer did; all NaN where nothing was scored."""

    scores: Scores
    calibration_error: float
    reliability: Reliability

    @classmethod
    def of(cls, sums: ScoreSums) -> "ScoredAnswers":
        """Those of all that was added."""
        table = sums.reliability()
        return cls(sums.scores(), expected_calibration_error(table), table)


@dataclass(frozen=True, slots=True, eq=False)
class HorizonScores:
    """Scores at one horizon: of the answer given what was read, of the rhythm, and of persistence alone.

    samples: the horizon as it was taken, at least one.
    """

    horizon_s: float
    samples: int
    conditioned: ScoredAnswers
    rhythm: ScoredAnswers
    persistence: ScoredAnswers


def evaluate_horizons(
    ctx: Context, location: LocationRecord, query: HorizonQuery, check: Callable[[], None]
) -> list[HorizonScores]:
    """Scores by horizon. What answers is learned anew a few times, always from the past of what is scored alone.

    Damaged chunks are left out. `check` is called between steps; what it raises ends this. Raises InvalidInputError.
    """
    plan, first, stop = _plan(ctx, location, query)
    sampled = sample_cells(ctx, location, (first, stop), check, SCORED_CELLS, until=plan.start, read=read_history)
    scored = _thinned(sampled, plan)
    if not scored.history.n_cells:
        raise InvalidInputError.at("start", "no cell changes before it, so nothing can be learned; choose a later one")
    erring = None if location.sensor is None else _erring(ctx, location, scored)
    sums = walk(scored.history, location.base, plan, partial(_recipe, location, check), check, erring)
    return [_scores(each, asked) for each, asked in zip(sums, query.horizons_s, strict=True)]


def _plan(ctx: Context, location: LocationRecord, query: HorizonQuery) -> tuple[WalkPlan, int, int]:
    """The walk, the first sample that is learned from and the end. Raises InvalidInputError."""
    known, base = window(ctx, location), location.base
    first, stop = base.clamp(known, query.train_start, query.stop)
    usual = first + int(PAST_SHARE * (stop - first))
    start = usual if query.start is None else max(first, int(base.sample(query.start)))
    if not first < start < stop:
        raise InvalidInputError.at("start", "something has to be known before start, and observed between it and stop")
    for i, horizon_s in enumerate(query.horizons_s):
        if not 0 < horizon_s <= MAX_HORIZON_S:
            raise InvalidInputError.at(f"horizons_s[{i}]", f"a horizon is more than 0 and at most {MAX_HORIZON_S:g} s")
    horizons = tuple(max(1, round(each / base.interval_s)) for each in query.horizons_s)
    if (stop - start) * len(horizons) > MAX_PREDICTIONS:
        raise InvalidInputError.at(
            "horizons_s",
            f"{stop - start} samples at {len(horizons)} horizons are more than {MAX_PREDICTIONS} predictions; "
            "evaluate a shorter time or fewer horizons",
        )
    step = max(round(DAY_S / base.interval_s), -(-(stop - start) // MAX_REFITS), 1)
    return WalkPlan(start, step, horizons), first, stop


def _thinned(sampled: SampledCells, plan: WalkPlan) -> SampledCells:
    """Evenly spread cells, as many as may be scored."""
    cost = (sampled.history.stop - plan.start) * len(plan.horizons)
    step = -(-sampled.history.n_cells * cost // MAX_PREDICTIONS)
    return sampled if step <= 1 else sampled.every(step)


def _erring(ctx: Context, location: LocationRecord, scored: SampledCells) -> Erring:
    """What is known of the sensor of a location, and what it measured of some cells."""
    given = location.sensor if isinstance(location.sensor, Sensor) else None
    return Erring(measured(ctx, location, scored, read_measured), given, location.hold_samples or 0)


def _recipe(location: LocationRecord, check: Callable[[], None], past: History) -> Recipe:
    """How an update would fit the past."""
    settings = (location, location.estimator, location.order or "auto")
    return (settled(*settings) or selected(*settings, past, check)).recipe


def _scores(sums: HorizonSums, asked_s: float) -> HorizonScores:
    kinds = (sums.conditioned, sums.rhythm, sums.persistence)
    return HorizonScores(asked_s, sums.horizon, *(ScoredAnswers.of(each) for each in kinds))
