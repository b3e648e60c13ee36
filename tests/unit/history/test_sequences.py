"""The readings of cells one after the other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.history import UNOBSERVED, History
from tidemap.history.sequences import Sequences

STATES = hnp.arrays(np.uint8, st.tuples(st.integers(0, 4), st.integers(0, 80)), elements=st.integers(0, 2))


def columns(sequences: Sequences) -> list[list[int]]:
    return [each.tolist() for each in (sequences.offset, sequences.sample, sequences.state)]


@given(states=STATES, start=st.integers(-100, 100))
def test_they_are_the_readings_of_the_history(states: np.ndarray, start: int) -> None:
    found = Sequences.of(History.from_states(states, start))
    assert found.count.tolist() == (states != UNOBSERVED).sum(axis=1).tolist()
    for cell in range(found.n_cells):
        mine = slice(found.offset[cell], found.offset[cell + 1])
        assert (np.diff(found.sample[mine]) > 0).all()
        assert states[cell, found.sample[mine] - start].tolist() == found.state[mine].tolist()


@given(states=STATES, cut=st.integers(0, 80))
def test_parts_are_joined_as_they_were(states: np.ndarray, cut: int) -> None:
    rows = np.arange(len(states))
    parts = [
        Sequences.of(History.from_states(states[:, :cut])),
        Sequences.of(History.from_states(states[:, cut:], cut)),
    ]
    joined = Sequences.joined(len(states), [(rows, part) for part in parts])
    assert columns(joined) == columns(Sequences.of(History.from_states(states)))


def test_parts_may_be_of_some_cells_only() -> None:
    part = Sequences.of(History.from_states(np.array([[1, 2], [0, 1]], np.uint8)))
    joined = Sequences.joined(4, [(np.array([3, 1]), part)])
    assert columns(joined) == [[0, 0, 2, 2, 3], [0, 1, 0], [0, 1, 1]]
    assert columns(Sequences.joined(2, [])) == [[0, 0, 0], [], []]


def test_the_latest_of_each_cell() -> None:
    sequences = Sequences.of(History.from_states(np.array([[1, 0, 1], [2, 2, 1], [2, 2, 2]], np.uint8)))
    assert sequences.select(sequences.latest(2)).sample.tolist() == [1, 2, 2]
    assert sequences.select(sequences.latest(np.array([1, 9, 0]))).sample.tolist() == [2, 2]
