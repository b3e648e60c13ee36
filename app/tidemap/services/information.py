"""Questions about when looking is worth most: the entropy of what is not known, and what a look would say."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError
from tidemap.services.beliefs import detector_of
from tidemap.services.context import Context
from tidemap.services.given import Given, known_at
from tidemap.services.parts import in_box
from tidemap.services.predict import predicted_blocks
from tidemap.services.series import times_between
from tidemap.services.spectra import Fitted, fitted
from tidemap.services.state import cells_in
from tidemap.spectral.civil import DAY_S
from tidemap.spectral.detector import Detector
from tidemap.spectral.information import ErrorRates, best_times, entropy_nats, information
from tidemap.spectral.sensor import Sensor

MAX_VALUES = 50_000_000
"""Cells times times of one question; more are refused."""
MAX_BEST = 100
USUAL_TIMES = 288
"""Times of a window at most, where its step is not said."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InformationQuery:
    """A question for one time (Unix seconds; by default now), or for [start, stop) every `step` seconds.

    A window is asked for by any of start, stop, step and best; by default it is the next day. `bbox`, `as_of` and
    `given` are as of a `StateQuery`; `best`: how many of the best times are wanted. miss, false_alarm: how often a look
    errs, by default as often as the location's sensor.
    """

    time: float | None = None
    start: float | None = None
    stop: float | None = None
    step: float | None = None
    bbox: tuple[float, ...] | None = None
    best: int = 0
    miss: float | None = None
    false_alarm: float | None = None
    as_of: float | None = None
    given: Given = "observations"

    @property
    def of_window(self) -> bool:
        """Whether it is about many times."""
        return self.best > 0 or any(each is not None for each in (self.start, self.stop, self.step))


@dataclass(frozen=True, slots=True, eq=False)
class CellInformation:
    """Of every cell (n,) at the only time: what is not known, and what a look is expected to say, in nats."""

    cell: NDArray[np.int64]
    entropy: NDArray[np.float64]
    information: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class InformationView:
    """entropy and information (n_times,): sums over the cells that were asked for and have been observed, in nats.

    best: rows of the best times, any two at least `apart_s` apart. cells: of a question for one time only.
    unavailable: ranges [first, stop) of cells that are left out because they are damaged.
    """

    time: NDArray[np.float64]
    entropy: NDArray[np.float64]
    information: NDArray[np.float64]
    n_cells: int
    cells: CellInformation | None
    best: NDArray[np.int64]
    apart_s: float
    as_of: float
    given: Given
    revision: int
    unavailable: list[tuple[int, int]]


def information_at(
    ctx: Context, name: str, query: InformationQuery, check: Callable[[], None] = lambda: None
) -> InformationView:
    """What looking is expected to say. `check` is called between blocks; what it raises ends this.

    Raises LocationNotFoundError, NoModelError, CorruptChunkError, InvalidInputError also when it asks for too much.
    """
    model = fitted(ctx, name, part=in_box(query.bbox))
    detector = detector_of(model)
    rates = _error_rates(query, detector)
    time, cell = _times(ctx, model, query), cells_in(model, query.bbox)
    _check_size(query, len(cell), len(time))
    as_of = ctx.clock() if query.as_of is None else query.as_of
    known = known_at(ctx, model, cell, as_of) if query.given == "observations" else None
    sums, cells = np.zeros((2, len(time))), None
    for part, p in predicted_blocks(model.spectrum, time, model.rows(cell), check, known):
        # The rhythm is that of readings, with what errs in them; beliefs are about the state.
        state = p if detector is None or known is not None else detector.sensor.state_probability(p)
        unknown, said = entropy_nats(state), information(state, rates)
        sums[:, part] = unknown.sum(axis=0), said.sum(axis=0)
        if not query.of_window:
            cells = CellInformation(cell, unknown[:, 0], said[:, 0])
    apart_s = _apart_s(model, query, time)
    return InformationView(
        time=time,
        entropy=sums[0],
        information=sums[1],
        n_cells=len(cell),
        cells=cells,
        best=best_times(time, sums[1], query.best, apart_s),
        apart_s=apart_s,
        as_of=as_of,
        given=query.given,
        revision=model.revision.revision,
        unavailable=model.location.cell_ranges({*model.damage, *(() if known is None else known.damaged)}),
    )


def _check_size(query: InformationQuery, n_cells: int, n_times: int) -> None:
    """Refuse what would take minutes, before it begins."""
    if n_cells * n_times > MAX_VALUES:
        raise InvalidInputError.at(
            "step" if query.of_window else "bbox",
            f"{n_cells} cells at {n_times} times are more than {MAX_VALUES} values; "
            "ask for fewer times or a smaller box",
        )


def _error_rates(query: InformationQuery, detector: Detector | None) -> ErrorRates:
    usual = Sensor(0.0, 0.0) if detector is None else detector.sensor
    miss = usual.miss if query.miss is None else query.miss
    try:
        return ErrorRates(miss, usual.false_alarm if query.false_alarm is None else query.false_alarm)
    except ValueError:
        raise InvalidInputError.at("miss", "miss and false_alarm are shares whose sum is less than 1") from None


def _times(ctx: Context, model: Fitted, query: InformationQuery) -> NDArray[np.float64]:
    """The only time, or those of the window."""
    if not query.of_window:
        return np.array([ctx.clock() if query.time is None else query.time])
    if query.time is not None:
        raise InvalidInputError.at("time", "ask for one time, or for a window by start, stop, step and best")
    start = query.start
    if start is None:
        start = ctx.clock() if query.stop is None else min(ctx.clock(), query.stop - DAY_S)
    stop = start + DAY_S if query.stop is None else query.stop
    return times_between(ctx, start, stop, query.step or _usual_step(model.location.interval_s, stop - start))


def _usual_step(interval_s: float, span_s: float) -> float:
    """So many whole samples that a window has `USUAL_TIMES` times at most.

    >>> _usual_step(60.0, 3600.0), _usual_step(60.0, 86400.0)
    (60.0, 300.0)
    """
    return interval_s * max(1, int(np.ceil(span_s / interval_s / USUAL_TIMES)))


def _apart_s(model: Fitted, query: InformationQuery, time: NDArray[np.float64]) -> float:
    """How far apart the best times are: a reading's half-life, as looking again sooner says little new, but so that
    as many as are wanted find room."""
    if not query.best or not len(time):
        return 0.0
    interval_s = model.location.interval_s
    half_life_s = model.revision.persistence.half_life_s(interval_s)
    room_s = (time[-1] - time[0]) / (2 * query.best)
    return float(max(interval_s, min(half_life_s, room_s)))
