"""What repeats in bit planes, against the same said with dense arrays."""

from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tidemap.history.patterns import distinct, fill_unobserved, transpose

planes = st.tuples(st.integers(0, 20), st.integers(0, 5)).flatmap(lambda shape: hnp.arrays(np.uint8, shape))
few = settings(max_examples=60)


def dense(plane: np.ndarray) -> np.ndarray:
    return np.unpackbits(plane, axis=1, bitorder="little")


@few
@given(planes)
def test_distinct_rows_give_the_plane_again(plane: np.ndarray) -> None:
    rows, which = distinct(plane)
    assert np.array_equal(rows[which], plane)
    assert len({row.tobytes() for row in rows}) == len(rows)
    assert list(dict.fromkeys(which.tolist())) == list(range(len(rows)))


@few
@given(planes)
def test_a_transposed_plane_has_its_columns_as_rows(plane: np.ndarray) -> None:
    turned = dense(transpose(plane))
    assert np.array_equal(turned[:, : len(plane)], dense(plane).T)
    assert not turned[:, len(plane) :].any()


@few
@given(planes, st.randoms(use_true_random=False))
def test_a_state_stands_until_the_next_that_was_observed(observed: np.ndarray, random: Random) -> None:
    occupied = observed & np.frombuffer(random.randbytes(observed.size), np.uint8).reshape(observed.shape)
    found = dense(fill_unobserved(observed, occupied))
    for seen, full, states in zip(dense(observed), dense(occupied), found, strict=True):
        at = np.flatnonzero(seen)
        if not len(at):
            assert not states.any()
            continue
        before = np.maximum(np.searchsorted(at, np.arange(len(seen)), side="right") - 1, 0)
        assert states.tolist() == full[at[before]].tolist()
