"""The latest run of readings of each cell, found backwards, whatever the pieces it is read in."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import NEVER, UNOBSERVED, History
from tidemap.history.runs import LatestRuns

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
