"""History: packed planes against the plain arrays they stand for."""

import numpy as np
import pytest

from tidemap.history.history import FREE, NEVER, OCCUPIED, UNOBSERVED, History
from tidemap.history.intervals import Intervals

STATES = np.array([[0, 1, 2, 2, 1, 0, 2, 2, 2, 1], [2] * 10, [1] * 10], np.uint8)


def test_a_window_reads_unobserved_outside_of_what_is_held() -> None:
    window = History.from_states(STATES, start=100).window(97, 103)
    assert window.start == 97
    np.testing.assert_array_equal(window.states()[0], [2, 2, 2, 0, 1, 2])


def test_counts() -> None:
    history = History.from_states(STATES)
    np.testing.assert_array_equal(history.count_observed(), [5, 0, 10])
    np.testing.assert_array_equal(history.count_occupied(), [3, 0, 10])
    np.testing.assert_array_equal(history.ever_observed(), [True, False, True])


def test_last_seen_is_the_latest_at_or_before() -> None:
    state, sample = History.from_states(STATES, start=-5).last_seen(3)
    np.testing.assert_array_equal(state, [FREE, UNOBSERVED, OCCUPIED])
    np.testing.assert_array_equal(sample, [0, NEVER, 3])
    assert History.from_states(STATES, start=-5).last_seen(-6)[1].tolist() == [NEVER] * 3


def test_hold_stands_until_the_next_measurement_or_the_limit() -> None:
    held = History.from_states(STATES[:1]).hold(2).states()[0]
    np.testing.assert_array_equal(held, [0, 1, 1, 1, 1, 0, 0, 0, 2, 1])


def test_series_and_cells_and_bounds() -> None:
    history = History.from_states(STATES, start=7)
    np.testing.assert_array_equal(history.series(0, 8, 10), [1, 2])
    np.testing.assert_array_equal(history.cells([2, 0]).states(), STATES[[2, 0]])
    with pytest.raises(IndexError):
        history.series(3, 0, 1)


def test_of_several_measurements_the_last_stands() -> None:
    history = History.from_measurements(2, 10, 20, [0, 1, 0], [12, 12, 12], [1, 1, 0])
    assert history.states()[:, 2].tolist() == [FREE, OCCUPIED]
    assert int(history.count_observed().sum()) == 2


def test_overlay_takes_the_newer_where_it_was_observed() -> None:
    older = History.from_states(np.array([[1, 1, 2]], np.uint8), start=0)
    newer = History.from_states(np.array([[0, 2, 1]], np.uint8), start=1)
    both = older.overlay(newer)
    assert (both.start, both.states()[0].tolist()) == (0, [1, 0, 2, 1])


def test_intervals_are_runs_of_constant_state() -> None:
    runs = History.from_states(np.array([[0, 0, 1, 2, 2]], np.uint8), start=3).intervals()
    assert runs.offset.tolist() == [0, 3]
    assert runs.start.tolist() == [3, 5, 6]
    assert runs.stop.tolist() == [5, 6, 8]
    assert runs.state.tolist() == [FREE, OCCUPIED, UNOBSERVED]


def test_an_empty_history() -> None:
    history = History.empty(3)
    assert history.states().shape == (3, 0)
    assert history.intervals().start.size == 0
    assert History.from_intervals(Intervals.empty(3)).n_cells == 3


@pytest.mark.parametrize("states", [np.array([[3]]), np.array([[-1]]), np.zeros(4, np.uint8)])
def test_other_states_are_refused(states: np.ndarray) -> None:
    with pytest.raises(ValueError, match="states are"):
        History.from_states(states)


def test_wrong_planes_are_refused() -> None:
    plane = np.zeros((2, 2), np.uint8)
    with pytest.raises(ValueError, match="need planes of shape"):
        History(0, 17, plane, plane)
    with pytest.raises(ValueError, match="nothing was observed"):
        History(0, 16, plane, plane + np.uint8(1)).check()
    with pytest.raises(ValueError, match="after the last sample"):
        History(0, 9, plane + np.uint8(2), plane).check()


@pytest.mark.parametrize(
    ("cell", "sample", "state"), [([2], [10], [1]), ([0], [20], [1]), ([0], [10], [2]), ([0, 1], [10], [1])]
)
def test_measurements_out_of_range_are_refused(cell: list[int], sample: list[int], state: list[int]) -> None:
    with pytest.raises(ValueError, match=r"."):
        History.from_measurements(2, 10, 20, cell, sample, state)
