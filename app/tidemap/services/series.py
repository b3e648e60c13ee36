"""One cell over time: what was predicted and what was observed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError, refuse_reversed
from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.history import read_cell, read_measurements, window
from tidemap.services.parts import Cells
from tidemap.services.predict import check_cell, predict_in_blocks, state_or_unknown
from tidemap.services.spectra import fitted
from tidemap.storage.records import LocationRecord


@dataclass(frozen=True, slots=True, eq=False)
class SeriesView:
    """One cell over time, (n,) each; state and observed are 2 where unknown.

    probability and state are those of the sample that contains the time. So is observed; of a step that is longer than
    a sample it is the latest measurement in [time, time + step), where there is one. time_zone: the location's.
    """

    name: str
    time_zone: str
    cell: int
    time: NDArray[np.float64]
    probability: NDArray[np.float32]
    state: NDArray[np.uint8]
    observed: NDArray[np.uint8]
    revision: int


@dataclass(frozen=True, slots=True)
class SeriesQuery:
    """One cell over [start, stop) every `step` seconds, by default the part of its history that is modelled, at every
    sample, or the end of that where an answer may not be so long."""

    cell: int = 0
    start: float | None = None
    stop: float | None = None
    step: float | None = None


WHOLE = SeriesQuery()


def series(ctx: Context, name: str, query: SeriesQuery = WHOLE, check: Callable[[], None] = lambda: None) -> SeriesView:
    """Without a model the probability is NaN and the revision 0. `check` is called between blocks of times.

    Raises LocationNotFoundError, CellNotFoundError,
    CorruptChunkError, InvalidInputError.
    """
    with ctx.store.read() as work:
        location = work.locations.get(name)
    cell = query.cell
    check_cell(location, cell)
    first, last = window(ctx, location)
    if query.step is None:
        first = max(first, last - ctx.settings.max_points + 1)
    start = float(location.base.time(first)) if query.start is None else query.start
    stop = float(location.base.time(last)) if query.stop is None else query.stop
    step = location.interval_s if query.step is None else query.step
    time = times_between(ctx, start, stop, step)
    probability = np.full(len(time), np.nan, np.float32)
    revision = 0
    if location.revision:
        model = fitted(ctx, name, part=Cells(np.array([cell])))
        model.check_readable([cell])
        probability, revision = (
            predict_in_blocks(model.spectrum, time, model.rows(np.array([cell])), check)[0],
            model.revision.revision,
        )
    observed = _observed_at(ctx, location, cell, time)
    if step > location.interval_s:
        _show_latest(ctx, location, cell, time, step, observed)
    state = state_or_unknown(probability, location.confidence)
    return SeriesView(name, location.time_zone, cell, time, probability, state, observed, revision)


def times_between(ctx: Context, start: float, stop: float, step: float) -> NDArray[np.float64]:
    """[start, stop) every `step` seconds, (n,). Raises InvalidInputError, also where they are too many."""
    if not step > 0:
        raise InvalidInputError.at("step", "give a positive number of seconds")
    refuse_reversed(start, stop)
    most = ctx.settings.max_points
    if stop - start > most * step:
        raise InvalidInputError.at("step", f"these are more than {most} times; use a longer step or a shorter range")
    return np.asarray(start + step * np.arange(int(np.ceil((stop - start) / step))), np.float64)


def _observed_at(ctx: Context, location: LocationRecord, cell: int, time: NDArray[np.float64]) -> NDArray[np.uint8]:
    first, last = window(ctx, location)
    sample = location.base.sample(time)
    inside = (sample >= first) & (sample < last)
    observed = np.full(len(time), UNOBSERVED, np.uint8)
    if inside.any():
        low, high = int(sample[inside].min()), int(sample[inside].max()) + 1
        states = read_cell(ctx, location, cell, low, high).states()[0]
        observed[inside] = states[sample[inside] - low]
    return observed


def _show_latest(
    ctx: Context,
    location: LocationRecord,
    cell: int,
    time: NDArray[np.float64],
    step: float,
    observed: NDArray[np.uint8],
) -> None:
    """In place: of every step that holds measurements the latest."""
    if not len(time):
        return
    first, last = window(ctx, location)
    low, high = (int(location.base.sample(each)) for each in (time[0], time[-1] + step))
    measured = read_measurements(ctx, location, cell, max(first, low), min(last, high + 1))
    inside = measured.select((measured.time >= time[0]) & (measured.time < time[-1] + step))
    observed[np.searchsorted(time, inside.time, side="right") - 1] = inside.state
