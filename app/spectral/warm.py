"""Warming: the kernels compiled, or loaded from the cache on disk, before the first request."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.spectral.anomaly import surprising
from app.spectral.history import History
from app.spectral.look import order_look, plane_cells, seen_plane
from app.spectral.model import add, reconstruct, update
from app.spectral.prediction import Answer, predict, predict_times, write_waves
from app.spectral.selection import choose
from app.spectral.timebase import TimeBase


def warm() -> None:
    """Run everything once on a few samples; seconds when nothing is cached, else some tenths.

    Also on read-only planes, which is what arrays over stored bytes are.
    """
    states = (np.arange(3 * 200).reshape(3, 200) % 7 < 3).astype(np.uint8)
    states[1, 50:60] = 2
    fresh = History.from_states(states, start=3)
    stored = replace(fresh, observed=_read_only(fresh.observed), occupied=_read_only(fresh.occupied))
    base = TimeBase(0.0, 60.0)
    for history in (fresh, stored):
        model = update(history.window(0, 150), "fft", 3, base)
        reconstruct(update(history, "calendar", 3, base))
        update(history, "fft", 3, base)
        reconstruct(add(model, 170, 1))
        history.hold(2)
        history.last_seen(100)
        history.ever_observed()
        History.from_intervals(history.intervals())
        kept = replace(
            model.spectrum,
            mean=_read_only(model.spectrum.mean),
            cell=_read_only(model.spectrum.cell),
            index=_read_only(model.spectrum.index),
            coefficient=_read_only(model.spectrum.coefficient),
            frequency_hz=_read_only(model.spectrum.frequency_hz),
        )
        for spectrum in (model.spectrum, kept, replace(kept, time_zone="UTC")):
            predict(spectrum, 0.0)
            predict(spectrum, 0.0, [0])
            n = spectrum.n_cells
            answer = Answer(np.zeros(n, np.float32), np.zeros(n, np.uint8), np.zeros(n, np.uint8))
            write_waves(spectrum, 0.0, 0.5, spectrum.cell, answer)
            predict_times(spectrum, [0.0, 1.0])
            surprising(spectrum, 0.0, np.zeros(1, np.uint32), np.zeros(1, np.uint8), 0.9)
            reconstruct(replace(model, spectrum=spectrum))
    order_look(np.zeros(1), np.zeros(1, np.uint32), np.zeros(1, np.uint8), (0.0, 1.0), 1)
    seen_plane(np.zeros(1, np.uint32))
    plane_cells(np.ones(1, np.uint8), 0, 1)
    choose(History.from_states((np.arange(2 * 4500).reshape(2, 4500) % 9 < 3).astype(np.uint8)), base, time_zone="UTC")


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    copy = array.copy()
    copy.flags.writeable = False
    return copy
