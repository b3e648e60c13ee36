"""The latest run of readings of each cell, found backwards, whatever the pieces it is read in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.runs import UNKNOWN_BEFORE, LaterReadings, LatestRuns

STATES = hnp.arrays(np.uint8, st.tuples(st.integers(1, 4), st.integers(1, 200)), elements=st.sampled_from([0, 1, 2, 2]))


def slow(states: np.ndarray, last: int) -> tuple[int, int, int, bool]:
    """State, sample and begin of the latest run of one cell, and whether a reading before it is there."""
    seen = [n for n in range(min(last, states.size - 1) + 1) if states[n] != UNOBSERVED]
    if not seen:
        return UNOBSERVED, NEVER, NEVER, False
    state = int(states[seen[-1]])
    run = seen
    for back, n in enumerate(reversed(seen)):
        if states[n] != state:
            run = seen[len(seen) - back :]
            return state, run[-1], run[0], True
    return state, run[-1], run[0], False


@given(states=STATES, last=st.integers(-2, 220), cut=st.integers(0, 200), start=st.integers(-100, 100))
def test_runs_are_followed_back_through_pieces(states: np.ndarray, last: int, cut: int, start: int) -> None:
    history = History.from_states(states, start)
    border = start + min(cut, states.shape[1])
    runs = LatestRuns.none(history.n_cells)
    for piece in (history.window(border, history.stop), history.window(start, border)):
        runs.extend(piece, start + last)
    for cell in range(history.n_cells):
        state, sample, begin, whole = slow(states[cell], last)
        known = state != UNOBSERVED
        found = (runs.state[cell], runs.sample[cell], runs.begin[cell], runs.whole[cell])
        assert found == (state, sample + start if known else NEVER, begin + start if known else NEVER, whole)


def test_runs_of_some_cells_are_taken_and_put() -> None:
    history = History.from_states(np.array([[0, 1, 2], [1, 1, 1], [2, 2, 2]], np.uint8))
    runs = LatestRuns.none(3)
    runs.extend(history, 2)
    other = LatestRuns.none(3)
    other.put([2, 0], runs.cells([0, 1]))
    assert other.state.tolist() == [1, UNOBSERVED, 1]
    assert other.begin.tolist() == [0, NEVER, 1]


@given(
    states=STATES,
    later=st.lists(st.tuples(st.sampled_from((0.0, 0.3, 0.7, 2.0)), st.integers(0, 3), st.integers(0, 1)), max_size=20),
    posts=st.integers(1, 5),
)
def test_runs_that_are_read_on_are_those_of_the_whole_history(
    states: np.ndarray, later: list[tuple[float, int, int]], posts: int
) -> None:
    n_cells, n_samples = states.shape
    runs, before = LatestRuns.none(n_cells), UNKNOWN_BEFORE
    runs.extend(History.from_states(states), n_samples)
    whole = np.full((n_cells, n_samples + 50), UNOBSERVED, np.uint8)
    whole[:, :n_samples] = states
    times = n_samples + np.cumsum([gap for gap, _, _ in later])
    rows = np.arange(n_cells)
    lost = np.zeros(n_cells, np.bool_)
    for part in np.array_split(np.arange(len(later)), posts):
        readings = [(cell % n_cells, times[i], state) for i in part for _, cell, state in [later[i]]]
        cell, time, state = (
            np.array(column, kind)
            for column, kind in zip(
                zip(*readings, strict=True) if readings else ((), (), ()), (np.int64, np.float64, np.uint8), strict=True
            )
        )
        # Of two at one time the occupied one.
        order = np.lexsort((state, time))
        whole[cell[order], time[order].astype(np.int64)] = state[order]
        known = before.of(rows)
        lost |= runs.read_on(LaterReadings.latest(cell, time.astype(np.int64), time, state), known)
        before = before.replaced(rows, known)
    for row in np.flatnonzero(~lost).tolist():
        found = (runs.state[row], runs.sample[row], runs.begin[row])
        assert found == slow(whole[row], whole.shape[1])[:3]
