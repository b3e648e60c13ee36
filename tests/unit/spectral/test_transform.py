"""The fft estimator against numpy's double-precision transform."""

import numpy as np
import pytest

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import transform
from tidemap.spectral.estimators import fit
from tidemap.spectral.spectrum import Spectrum, components

BASE = TimeBase(0.0, 60.0)


def slow_coefficients(states: np.ndarray) -> np.ndarray:
    """(F[mask s] - m F[mask]) / (N + 1) of one cell, DC zero, Nyquist halved."""
    mask = states != 2
    mean = states[mask].mean()
    transformed: np.ndarray = np.fft.rfft(mask * (states == 1)) - mean * np.fft.rfft(mask)
    transformed[0] = 0
    if states.size % 2 == 0:
        transformed[-1] /= 2
    transformed /= mask.sum() + 1
    return transformed


def dense(spectrum: Spectrum, cell: int, n_samples: int) -> np.ndarray:
    found = components(spectrum, cell)
    bins = np.rint(found.frequency_hz * n_samples * BASE.interval_s).astype(int)
    coefficients = np.zeros(n_samples // 2 + 1, complex)
    coefficients[bins] = found.amplitude / 2 * np.exp(1j * found.phase)
    return coefficients


@pytest.mark.parametrize("n_samples", [2, 3, 64, 101, 288, 1009])
@pytest.mark.parametrize("unobserved", [0.0, 0.4])
def test_the_greatest_coefficients_of_the_masked_transform(n_samples: int, unobserved: float) -> None:
    random = np.random.default_rng(n_samples)
    states = random.integers(0, 2, (9, n_samples)).astype(np.uint8)
    states[random.random(states.shape) < unobserved] = 2
    spectrum = fit(History.from_states(states), "fft", 5, BASE)
    for cell in spectrum.cell:
        truth = slow_coefficients(states[cell])
        found = dense(spectrum, int(cell), n_samples)
        kept = np.flatnonzero(found)
        np.testing.assert_allclose(found[kept], truth[kept], atol=1e-6)
        left = np.abs(np.delete(truth, kept)).max(initial=0)
        assert np.abs(found[kept]).min(initial=1) >= left - 1e-6


def test_all_coefficients_give_the_signal_back_with_half_a_visit_of_each_state() -> None:
    states = np.random.default_rng(1).integers(0, 2, (3, 90)).astype(np.uint8)
    spectrum = fit(History.from_states(states), "fft", 64, BASE)
    for cell in range(3):
        signal = np.fft.irfft(dense(spectrum, cell, 90) * np.r_[np.full(45, 90), 180], 90)
        np.testing.assert_allclose(signal + spectrum.mean[cell], (90 * states[cell] + 0.5) / 91, atol=1e-5)


def test_ties_go_to_the_lower_frequency() -> None:
    states = np.zeros((1, 8), np.uint8)
    states[0, 0] = 1  # all bins 1..3 are equal, the Nyquist bin counts half
    spectrum = fit(History.from_states(states), "fft", 3, BASE)
    np.testing.assert_allclose(components(spectrum, 0).frequency_hz * 480, [1, 2, 3])


def test_the_nyquist_bin_is_ranked_by_what_it_contributes() -> None:
    states = np.random.default_rng(6).integers(0, 2, (300, 8)).astype(np.uint8)
    spectrum = fit(History.from_states(states), "fft", 1, BASE)
    for cell in spectrum.cell:
        greatest = np.abs(slow_coefficients(states[cell])).max()
        np.testing.assert_allclose(components(spectrum, int(cell)).amplitude, 2 * greatest, atol=1e-6)


def test_constant_and_unobserved_cells_have_no_waves() -> None:
    states = np.array([[0] * 20, [1] * 20, [2] * 20, [1, 2] * 10], np.uint8)
    spectrum = fit(History.from_states(states), "fft", 5, BASE)
    assert spectrum.cell.size == spectrum.n_waves == 0
    np.testing.assert_array_equal(spectrum.mean, np.array([0.5 / 21, 20.5 / 21, np.nan, 10.5 / 11], np.float32))


def test_block_size_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    states = np.random.default_rng(2).integers(0, 2, (70, 200)).astype(np.uint8)
    whole = fit(History.from_states(states), "fft", 6, BASE)
    monkeypatch.setattr(transform, "BATCH_ROWS", 3)
    parts = fit(History.from_states(states), "fft", 6, BASE)
    np.testing.assert_array_equal(whole.coefficient, parts.coefficient)
    np.testing.assert_array_equal(whole.index, parts.index)


def test_unknown_estimators_and_negative_orders_are_refused() -> None:
    history = History.empty(1, 0, 5)
    with pytest.raises(ValueError, match="known are calendar, fft, static"):
        fit(history, "fourier", 2, BASE)
    with pytest.raises(ValueError, match="negative"):
        fit(history, "fft", -1, BASE)
