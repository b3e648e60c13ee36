"""Spectrum, civil time and prediction: the shape, and every fast path against the direct sum."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from typing import ClassVar
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from numpy.typing import NDArray

from tidemap.history.bits import WORD
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral import prediction, reconstruction, state_columns
from tidemap.spectral.civil import civil_seconds
from tidemap.spectral.conditioning import UNLEARNED, Evidence
from tidemap.spectral.estimators import fit
from tidemap.spectral.prediction import (
    entropy,
    known,
    predict,
    predict_slow,
    predict_times,
    probability,
    state,
    verdict,
)
from tidemap.spectral.spectrum import Link, Spectrum, components, concatenate, select, truncate
from tidemap.spectral.state_columns import StateColumns, Waves, write_conditioned, write_waves

BASE = TimeBase(epoch=1.7e9, interval_s=300.0)
BOUND = 2e-5
"""How far the float32 gathers may be from the direct float64 sum at order 15."""


def spectrum(n_cells: int = 40, order: int = 15) -> Spectrum:
    """Cell 0 constant, cell 1 never observed, the others varying."""
    states = np.random.default_rng(3).integers(0, 2, (n_cells, 576)).astype(np.uint8)
    states[0], states[1] = 1, 2
    return fit(History.from_states(states, start=11), "fft", order, BASE)


def calendar(link: Link = "logit") -> Spectrum:
    """Gated waves on civil time, as `calendar` will have them."""
    fitted = spectrum()
    gate = (np.arange(fitted.n_waves) % 3 == 0).astype(np.uint8)
    return replace(fitted, gate=gate, time_zone="Europe/London", link=link)


@pytest.mark.parametrize("model", [spectrum(), calendar(), calendar("identity")])
def test_every_fast_path_gives_the_direct_sum(model: Spectrum) -> None:
    times = BASE.time(np.arange(-700, 1500, 7) + 0.3)
    truth = predict_slow(model, times)
    np.testing.assert_allclose(predict_times(model, times), truth, atol=BOUND)
    np.testing.assert_allclose(predict(model, times[5]), truth[:, 5], atol=BOUND)
    cells = np.array([5, 1, 0, 5, 39])
    np.testing.assert_allclose(predict(model, times[5], cells), truth[cells, 5], atol=BOUND)
    np.testing.assert_array_equal(predict_times(model, times, cells), predict_times(model, times)[cells])


@pytest.mark.parametrize("model", [spectrum(), calendar(), calendar("identity")])
def test_the_words_are_the_thresholded_direct_sum(model: Spectrum) -> None:
    start, stop = -130, 700
    words = reconstruction.predicted_words(model, BASE, start, stop)
    first = WORD * (start // WORD)
    bits = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")
    truth = predict_slow(model, BASE.time(first + np.arange(bits.shape[1])))
    clear = np.abs(truth - 0.5) > BOUND
    np.testing.assert_array_equal(bits[clear], (truth > 0.5)[clear])


@pytest.mark.parametrize("model", [spectrum(), calendar()])
def test_small_tables_change_nothing(model: Spectrum, monkeypatch: pytest.MonkeyPatch) -> None:
    times = BASE.time(np.arange(300))
    whole = predict_times(model, times), reconstruction.predicted_words(model, BASE, 0, 900)
    monkeypatch.setattr(prediction, "TABLE_SIZE", 1)
    monkeypatch.setattr(reconstruction, "TABLE_SIZE", 1)
    np.testing.assert_array_equal(predict_times(model, times), whole[0])
    np.testing.assert_array_equal(reconstruction.predicted_words(model, BASE, 0, 900), whole[1])


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    model = spectrum()
    alone = predict(model, 1.7e9), written(model, 1.7e9, 0.8)
    monkeypatch.setattr(prediction, "WORTHWHILE", 1)
    monkeypatch.setattr(state_columns, "BLOCK", 5)
    monkeypatch.setattr(prediction, "ThreadPoolExecutor", ManyThreads)
    np.testing.assert_array_equal(predict(model, 1.7e9, threads=3), alone[0])
    for apart, together in zip(written(model, 1.7e9, 0.8, threads=3), alone[1], strict=True):
        np.testing.assert_array_equal(apart, together)
    assert ManyThreads.started == [3, 3]


@pytest.mark.parametrize("threads", [1, 3])
def test_what_is_conditioned_in_parts_is_what_is_conditioned_whole(
    monkeypatch: pytest.MonkeyPatch, threads: int
) -> None:
    monkeypatch.setattr(prediction, "WORTHWHILE", 1)
    monkeypatch.setattr(state_columns, "CONDITIONED", 7)
    model, time, confidence = spectrum(), 1.7e9, 0.8
    cells = known(model)
    random, n = np.random.default_rng(1), len(cells)
    sample, age = random.integers(0, 4, n) + 1_699_999_990, random.integers(1, 4, n).astype(np.uint32)
    evidence = Evidence(random.integers(0, 3, n).astype(np.uint8), sample, age, random.random(n, np.float32))
    asked = np.array([int(time)])

    def condition(rows: slice, p: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        evidence.part(rows).condition(p[:, np.newaxis], asked, 1.0, UNLEARNED, out=out[:, np.newaxis])

    at = np.searchsorted(cells, model.cell).astype(np.int32)
    out = StateColumns(np.zeros(n, np.float32), np.zeros(n, np.uint8), np.zeros(n, np.uint8))
    standing = probability(model, model.mean[cells])
    write_conditioned(Waves.of(model, at, time), standing, condition, confidence, out, threads)
    p = evidence.condition(predict(model, time, cells)[:, np.newaxis], asked, 1.0, UNLEARNED)[:, 0]
    assert (p != predict(model, time, cells)).any()
    expected = (p, state(p, confidence), verdict(p, confidence))
    for mine, plain in zip((out.probability, out.state, out.verdict), expected, strict=True):
        np.testing.assert_array_equal(mine, plain)


class ManyThreads(ThreadPoolExecutor):
    """Remembers how many threads were asked for."""

    started: ClassVar[list[int]] = []

    def __init__(self, max_workers: int) -> None:
        super().__init__(max_workers)
        self.started.append(max_workers)


def written(
    model: Spectrum, time: float, confidence: float, threads: int = 1
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]:
    """What `write_waves` writes of all cells, beginning with what holds at all times."""
    standing = probability(model, model.mean.copy())
    out = StateColumns(standing, state(standing, confidence), verdict(standing, confidence))
    write_waves(model, time, confidence, model.cell, out, threads)
    return out.probability, out.state, out.verdict


@pytest.mark.parametrize("model", [spectrum(), calendar(), calendar("identity")])
def test_what_is_written_is_what_is_predicted(model: Spectrum) -> None:
    for time in BASE.time(np.arange(-700, 1500, 70)):
        p = predict(model, time)
        for confidence in (0.5, 0.7, 0.75, 0.9, float(p[7]), float(1 - p[9])):
            told = written(model, time, confidence)
            for mine, plain in zip(told, (p, state(p, confidence), verdict(p, confidence)), strict=True):
                np.testing.assert_array_equal(mine, plain)


def test_cells_without_waves() -> None:
    model = spectrum()
    probability = predict(model, 0.0)
    assert probability[0] == model.mean[0] > 0.99
    assert np.isnan(probability[1])
    assert components(model, 0).amplitude.size == 0


def test_components_sum_to_the_prediction() -> None:
    model, time = spectrum(), 1.7e9 + 12_345.0
    found = components(model, 7)
    assert np.all(np.diff(found.amplitude) <= 0)
    angle = 2 * np.pi * found.frequency_hz * (BASE.time(BASE.sample(time)) - model.origin_s) + found.phase
    value = model.mean[7] + np.sum(found.amplitude * np.cos(angle))
    np.testing.assert_allclose(np.clip(value, 0, 1), predict(model, time, [7])[0], atol=BOUND)


def test_truncating_is_fitting_at_the_smaller_order() -> None:
    for order in (0, 1, 6):
        same(truncate(spectrum(order=15), order), spectrum(order=order))


def test_chunks_concatenate_to_the_whole() -> None:
    whole = spectrum()
    chunks = [select(whole, range(a, b)) for a, b in ((0, 2), (2, 3), (3, 40))]
    same(concatenate(chunks), whole)


def test_a_batch_does_not_change_a_cell() -> None:
    states = np.random.default_rng(5).integers(0, 3, (150, 100)).astype(np.uint8)
    history = History.from_states(states)
    parts = [fit(history.cells(np.arange(a, b)), "fft", 4, BASE) for a, b in ((0, 1), (1, 70), (70, 150))]
    same(concatenate(parts), fit(history, "fft", 4, BASE))


def test_what_does_not_fit_together_is_refused() -> None:
    one = spectrum()
    with pytest.raises(ValueError, match="differ in link"):
        concatenate([one, replace(one, base=TimeBase(0.0, 1.0))])
    with pytest.raises(ValueError, match="nothing"):
        concatenate([])
    with pytest.raises(IndexError):
        predict(one, 0.0, [40])
    with pytest.raises(ValueError, match="negative"):
        truncate(one, -1)


def test_civil_time_is_what_the_clock_shows_across_both_changes() -> None:
    zone = ZoneInfo("Europe/London")
    for day in (datetime(2024, 3, 31, tzinfo=zone), datetime(2024, 10, 27, tzinfo=zone)):
        times = day.timestamp() + np.arange(0, 86_400, 613.0)
        shown = [datetime.fromtimestamp(time, zone) for time in times]
        seconds = [s.weekday() * 86_400 + s.hour * 3600 + s.minute * 60 + s.second for s in shown]
        np.testing.assert_array_equal(civil_seconds(times, "Europe/London") % 604_800, seconds)


def test_state_verdict_and_entropy() -> None:
    p = np.array([0.0, 0.5, 0.95, 0.96, np.nan], np.float32)
    assert state(p, 0.5).tolist() == [0, 0, 1, 1, 0]
    assert verdict(p, 0.955).tolist() == [0, 2, 2, 1, 2]
    assert verdict(0.5, 0.5) == 2, "on the limit nothing is certain"
    limit = np.array([0.6], np.float32)
    assert limit > np.float64(0.6), "it is rounded up"
    assert (state(limit, 0.6).tolist(), verdict(limit, 0.6).tolist()) == ([0], [2]), "and still not exceeded by itself"
    assert verdict([0, 1], 0.9).tolist() == [0, 1]
    assert entropy(p)[:2].tolist() == [0, 1]
    assert np.isnan(entropy(p)[4])


def same(one: Spectrum, other: Spectrum) -> None:
    """Bit for bit."""
    assert (one.link, one.origin_s, one.time_zone, one.order) == (
        other.link,
        other.origin_s,
        other.time_zone,
        other.order,
    )
    for name in ("frequency_hz", "gate", "mean", "cell", "index", "coefficient"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name, strict=True)
