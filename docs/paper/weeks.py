"""Nine rooms over weeks 9 to 16, each week predicted by everybody from all weeks before it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from docs.paper import recordings
from docs.paper.forecasts import ORDERS, Probability, Samples, automatic, histograms
from docs.paper.recordings import WEEK_MINUTES as WEEK
from tidemap.history.history import History
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import truncate
from tidemap.spectral.window import fit_window

FIRST, LAST = 8, 16
AUTO = "auto"


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """The truth of weeks 9 to 16 and what every candidate expected of it."""

    truth: NDArray[np.uint8]
    expected: dict[str, Probability]


@cache
def every_room() -> list[Room]:
    """About two minutes."""
    signal = recordings.aruba()
    return [_room(signal.history.cells([cell])) for cell in range(signal.history.n_cells)]


def _room(history: History) -> Room:
    parts: dict[str, list[Probability]] = {}
    for week in range(FIRST, LAST):
        ahead = np.arange(week * WEEK, (week + 1) * WEEK)
        for name, p in _forecasts(history.window(0, week * WEEK), ahead):
            parts.setdefault(name, []).append(p)
    truth = history.window(FIRST * WEEK, LAST * WEEK).states()[0]
    return Room(truth, {name: np.concatenate(each) for name, each in parts.items()})


def _forecasts(past: History, ahead: Samples) -> Iterator[tuple[str, Probability]]:
    signal = recordings.aruba()
    base = signal.base
    yield AUTO, automatic(past, base, signal.time_zone, ahead)[0]
    window = past.window(*fit_window(past.start, past.stop, base.interval_s))
    most = fit_recipe(window, Recipe("fft", max(ORDERS)), base)
    for order in ORDERS:
        yield f"fft {order}", predict_times(truncate(most, order), base.time(ahead))[0]
    yield from histograms(past, base, signal.time_zone, ahead)
