"""The paper's office week: its accuracies and its anomalies, as FINDINGS.md has them."""

import time

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.office import Office, Signal
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.anomaly import is_anomalous
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.model import SpectralModel, accuracy, reconstruct, update
from tidemap.spectral.outliers import count, find_outliers
from tidemap.spectral.prediction import predict_times

BASE = TimeBase(0.0, 1.0)
ORDERS = (0, 1, 2, 3, 5, 10, 15, 20)
RECONSTRUCTION = (0.742, 0.799, 0.867, 0.887, 0.916, 0.938, 0.953, 0.955)
DAY_1 = (0.642, 0.884, 0.968, 0.889, 0.928, 0.976, 0.976, 0.978)
DAY_2 = (0.734, 0.894, 0.953, 0.906, 0.814, 0.862, 0.785, 0.791)


def history(signal: Signal) -> History:
    return History.from_states(signal.state[np.newaxis], start=int(signal.time_s[0]))


def model(office: Office, order: int) -> SpectralModel:
    return update(history(office.week), "fft", order, BASE)


def predicted(spectrum_of: SpectralModel, day: Signal) -> float:
    wrong = count(find_outliers(spectrum_of.spectrum, history(day), BASE))
    return 1 - float(wrong[0]) / day.state.size


TABLE = list(zip(ORDERS, RECONSTRUCTION, DAY_1, DAY_2, strict=True))


@pytest.mark.parametrize(("order", "week", "day_1", "day_2"), TABLE)
def test_the_papers_accuracies(office: Office, order: int, week: float, day_1: float, day_2: float) -> None:
    fitted = model(office, order)
    found = accuracy(fitted), predicted(fitted, office.day_1), predicted(fitted, office.day_2)
    assert found == pytest.approx((week, day_1, day_2), abs=6e-4)


@pytest.mark.parametrize("order", [0, 2, 15, 40])
def test_the_week_comes_back_exactly(office: Office, order: int) -> None:
    np.testing.assert_array_equal(reconstruct(model(office, order))[0], office.week.state)


def test_the_anomalies_of_the_week(office: Office) -> None:
    probability = predict_times(model(office, 15).spectrum, office.week.time_s)[0]
    assert runs(is_anomalous(probability, office.week.state, 0.95)) == 44
    assert is_anomalous(probability, office.week.state, 0.95, "paper").mean() == pytest.approx(0.18, abs=0.005)


def test_auto_is_quick_on_a_week_of_seconds(office: Office) -> None:
    started = time.process_time()
    chosen = choose(history(office.week), BASE)
    assert time.process_time() - started < 2
    assert len(chosen.table) == 7


def runs(flags: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(np.diff(flags.astype(np.int8), prepend=0) == 1))
