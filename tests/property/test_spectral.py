"""The core's theorems, over histories that hypothesis thinks of."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.measurements import Measurements
from tidemap.history.snapshot import sort_snapshot
from tidemap.history.timebase import TimeBase
from tidemap.spectral.anomaly import is_anomalous, surprising
from tidemap.spectral.estimators import ESTIMATORS
from tidemap.spectral.model import add, reconstruct, update
from tidemap.spectral.outliers import count, count_outliers, find_outliers
from tidemap.spectral.prediction import (
    known,
    predict,
    predict_slow,
    predict_times,
    probability,
    state,
    verdict,
)
from tidemap.spectral.spectrum import components
from tidemap.spectral.state_columns import StateColumns, write_waves
from tidemap.storage.blobs import pack_measurements, unpack_measurements

BASE = TimeBase(1.7e9, 300.0)
STATES = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(1, 4), st.integers(1, 300)),
    elements=st.integers(0, 2),
    fill=st.integers(0, 2),
)
HISTORIES = st.builds(History.from_states, STATES, start=st.integers(-(10**7), 10**7))
ORDERS = st.integers(0, 20)
NAMES = st.sampled_from(sorted(ESTIMATORS))
quick = settings(max_examples=60, deadline=None)


@quick
@given(HISTORIES, NAMES, ORDERS, ORDERS)
def test_reconstruction_is_lossless_and_the_order_can_change(
    history: History, estimator: str, order: int, other: int
) -> None:
    states = reconstruct(update(history, estimator, order, BASE))
    np.testing.assert_array_equal(states, history.states())
    again = update(History.from_states(states, history.start), estimator, other, BASE)
    np.testing.assert_array_equal(reconstruct(again), history.states())


@quick
@given(HISTORIES, ORDERS, st.integers(-100, 400), st.integers(0, 200))
def test_any_part_reconstructs_as_the_whole_does(history: History, order: int, first: int, n: int) -> None:
    model = update(history, "fft", order, BASE)
    start = history.start + first
    np.testing.assert_array_equal(reconstruct(model, start, start + n), history.window(start, start + n).states())


@quick
@given(HISTORIES, ORDERS, st.integers(-200, 500), st.integers(0, 1))
def test_an_added_measurement_is_reconstructed(history: History, order: int, at: int, state: int) -> None:
    sample = history.start + at
    model = add(update(history, "fft", order, BASE), sample, state)
    newer = History.from_measurements(history.n_cells, sample, sample + 1, [0], [sample], [state])
    np.testing.assert_array_equal(reconstruct(model), history.overlay(newer).states())


@quick
@given(HISTORIES, ORDERS)
def test_outliers_are_where_the_direct_sum_differs(history: History, order: int) -> None:
    model = update(history, "fft", order, BASE)
    truth = predict_slow(model.spectrum, BASE.time(np.arange(history.start, history.stop)))
    states = history.states()
    wrong = np.zeros(states.shape, bool)
    for cell in range(history.n_cells):
        for start, stop in model.outliers.of(cell) - history.start:
            wrong[cell, start:stop] = True
    # Within float32 rounding of 0.5 either answer is right.
    clear = (np.abs(truth - 0.5) > 2e-5) | (states == UNOBSERVED)
    np.testing.assert_array_equal(wrong[clear], (((truth > 0.5) != states) & (states != UNOBSERVED))[clear])


@quick
@given(HISTORIES, NAMES, ORDERS, hnp.arrays(np.float64, 5, elements=st.floats(-4e9, 4e9)))
def test_probabilities_are_in_0_to_1_or_never_observed(
    history: History, estimator: str, order: int, time: np.ndarray
) -> None:
    p = predict_times(update(history, estimator, order, BASE).spectrum, time)
    np.testing.assert_array_equal(np.isnan(p), np.repeat(~history.ever_observed()[:, None], 5, axis=1))
    assert np.all(np.isnan(p) | ((p >= 0) & (p <= 1)))


@quick
@given(HISTORIES, NAMES, ORDERS, st.floats(-4e9, 4e9), st.floats(0.5, 1, exclude_max=True))
def test_what_is_written_in_place_is_what_is_predicted(
    history: History, estimator: str, order: int, time: float, confidence: float
) -> None:
    spectrum = update(history, estimator, order, BASE).spectrum
    cells = known(spectrum)
    p = predict(spectrum, time, cells)
    standing = probability(spectrum, spectrum.mean[cells])
    out = StateColumns(standing, state(standing, confidence), verdict(standing, confidence))
    write_waves(spectrum, time, confidence, np.searchsorted(cells, spectrum.cell).astype(np.int32), out)
    np.testing.assert_array_equal(out.probability, p)
    np.testing.assert_array_equal(out.state, state(p, confidence))
    np.testing.assert_array_equal(out.verdict, verdict(p, confidence))


@quick
@given(HISTORIES, st.integers(-(10**6), 10**6))
def test_shifting_all_times_shifts_the_prediction(history: History, shift: int) -> None:
    later = History(history.start + shift, history.n_samples, history.observed, history.occupied)
    one, other = (update(each, "fft", 6, BASE).spectrum for each in (history, later))
    np.testing.assert_array_equal(one.coefficient, other.coefficient)
    np.testing.assert_array_equal(one.frequency_hz, other.frequency_hz)
    samples = history.start + np.arange(0, 600, 37)
    np.testing.assert_allclose(
        predict_times(one, BASE.time(samples)), predict_times(other, BASE.time(samples + shift)), atol=2e-5
    )


@quick
@given(st.integers(2, 200), st.integers(0, 199), st.data())
def test_turning_a_window_only_rotates_phases(n: int, turn: int, data: st.DataObject) -> None:
    states = data.draw(hnp.arrays(np.uint8, (1, n), elements=st.integers(0, 1)))
    everything = n // 2
    one = components(update(History.from_states(states), "fft", everything, BASE).spectrum, 0)
    turned = np.roll(states, turn, axis=1)
    other = components(update(History.from_states(turned), "fft", everything, BASE).spectrum, 0)
    # A component of no amplitude may be left out of one and not of the other.
    first, second = (np.pad(each.amplitude, (0, everything - each.amplitude.size)) for each in (one, other))
    np.testing.assert_allclose(np.sort(first), np.sort(second), atol=1e-5)


@quick
@given(HISTORIES)
def test_intervals_and_states_come_back(history: History) -> None:
    for copy in (
        History.from_intervals(history.intervals(), history.start, history.stop),
        History.from_states(history.states(), history.start),
    ):
        np.testing.assert_array_equal(copy.observed, history.observed)
        np.testing.assert_array_equal(copy.occupied, history.occupied)
        copy.check()


@quick
@given(HISTORIES, st.integers(-20, 320))
def test_last_seen_is_the_last_observed_column(history: History, at: int) -> None:
    sample = history.start + at
    state, seen = history.last_seen(sample)
    before = history.window(history.start, max(history.start, min(sample + 1, history.stop))).states()
    for cell in range(history.n_cells):
        observed = np.flatnonzero(before[cell] != UNOBSERVED)
        expected = (before[cell, observed[-1]], history.start + observed[-1]) if observed.size else (2, NEVER)
        assert (state[cell], seen[cell]) == expected


@quick
@given(HISTORIES, st.integers(0, 40))
def test_hold_is_a_bounded_forward_fill(history: History, hold: int) -> None:
    states = history.states()
    expected = states.copy()
    for cell, sample in np.argwhere(states != UNOBSERVED):
        for later in range(sample + 1, min(sample + hold + 1, history.n_samples)):
            if states[cell, later] != UNOBSERVED:
                break
            expected[cell, later] = states[cell, sample]
    np.testing.assert_array_equal(history.hold(hold).check().states(), expected)


@quick
@given(HISTORIES, st.integers(-(10**7), 10**7), st.integers(0, 300))
def test_outliers_of_any_history_are_consistent(history: History, start: int, n: int) -> None:
    """A spectrum judges any window, near its fit or years away."""
    spectrum = update(history, "fft", 4, BASE).spectrum
    window = history.window(start, start + n)
    outliers = find_outliers(spectrum, window, BASE)
    assert np.all(outliers.start < outliers.stop)
    assert outliers.offset[-1] == outliers.start.size
    np.testing.assert_array_equal(count_outliers(spectrum, window, BASE), count(outliers))


@quick
@given(
    HISTORIES,
    NAMES,
    ORDERS,
    st.floats(-4e9, 4e9),
    st.sampled_from([1e-9, 0.3, 0.5, 0.9, 0.999, 1 - 1e-12]),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1)), max_size=12),
)
def test_surprising_is_what_is_anomalous_of_what_is_predicted(
    history: History, estimator: str, order: int, time: float, confidence: float, seen: list[tuple[int, int]]
) -> None:
    spectrum = update(history, estimator, order, BASE).spectrum
    cells, states = np.array(seen, np.int64).reshape(-1, 2).T
    cells %= history.n_cells
    p = predict(spectrum, time, cells)
    marked = is_anomalous(p, states, confidence)
    rows, found = surprising(spectrum, time, cells.astype(np.uint32), states.astype(np.uint8), confidence)
    np.testing.assert_array_equal(rows, np.flatnonzero(marked))
    np.testing.assert_array_equal(found, p[marked])


@quick
@given(st.lists(st.tuples(st.sampled_from([0.0, 1.5, -3e9, 2e9]), st.integers(0, 2**32 - 1), st.integers(0, 1))))
def test_measurements_are_put_in_order_and_none_is_lost(rows: list[tuple[float, int, int]]) -> None:
    time, cell, state = np.array(rows or np.empty((0, 3))).T
    given_ = Measurements(time, cell.astype(np.uint32), state.astype(np.uint8))
    if rows:
        ordered = given_.in_order()
        assert list(zip(ordered.time, ordered.cell, ordered.state, strict=True)) == sorted(rows)


@quick
@given(st.data(), st.integers(1, 200))
def test_looks_of_any_number_of_ascending_runs_are_put_in_order(data: st.DataObject, n_runs: int) -> None:
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    cell = np.concatenate([np.sort(random.integers(0, 2**31 - 1, 5, np.uint32)) for _ in range(n_runs)])
    state = random.integers(0, 2, cell.size, np.uint8)
    ordered = Measurements(np.full(cell.size, 7.5), cell, state).in_order()
    assert list(zip(ordered.cell, ordered.state, strict=True)) == sorted(zip(cell, state, strict=True))


RUNS = st.lists(st.tuples(st.integers(0, 30), st.integers(0, 1)), max_size=12)


@quick
@given(RUNS, RUNS, st.sampled_from([-1.0, 0.0, 5.0, 5.5, np.nan, np.inf]), st.booleans(), st.integers(-1, 12))
def test_a_look_is_put_in_order_as_any_measurements_are_and_what_is_wrong_is_none(
    one: list[tuple[int, int]], other: list[tuple[int, int]], time: float, ascending: bool, elsewhen: int
) -> None:
    """Two runs of cells; a look where they ascend, are distinct, below 25, and of one time from 0 to 5."""
    rows = (sorted(one) + sorted(other)) if ascending else one + other
    cell, state = np.array(rows, np.int64).reshape(-1, 2).T
    times = np.full(len(rows), time)
    times[elsewhen : elsewhen + 1] += 1
    columns = (times, cell.astype(np.uint32), state.astype(np.uint8))
    look = sort_snapshot(*columns, (0.0, 5.0), 25)
    cells = [c for c, _ in rows]
    falls = sum(b <= a for a, b in pairwise(cells))
    plain = len(set(cells)) == len(cells) and falls <= 1 and len(set(times.tolist())) == 1 and 0 <= times[0] <= 5
    assert (look is not None) == (plain and max(cells) < 25)
    if look is not None:
        expected = Measurements(*columns).in_order()
        for name in ("time", "cell", "state", "heads"):
            np.testing.assert_array_equal(getattr(look, name), getattr(expected, name))
        assert unpack_measurements(pack_measurements(look), "look").cell.tolist() == sorted(cells)


def test_a_look_of_other_types_is_left_to_the_full_check() -> None:
    time, cell, state = np.zeros(2), np.arange(2, dtype=np.uint32), np.zeros(2, np.uint8)
    assert sort_snapshot(time, cell, state, (0.0, 1.0), 2) is not None
    assert sort_snapshot(time, cell.astype(np.int64), state, (0.0, 1.0), 2) is None
    assert sort_snapshot(time, cell, state + np.uint8(2), (0.0, 1.0), 2) is None
    assert sort_snapshot(time, np.arange(4, dtype=np.uint32)[::2], state, (0.0, 1.0), 4) is None
    unaligned = np.frombuffer(b"\0" * 17, np.uint8)[1:].view(np.float64)
    assert sort_snapshot(unaligned, cell, state, (0.0, 1.0), 2) is None
