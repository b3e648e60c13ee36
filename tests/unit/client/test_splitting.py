"""Splitting a refused batch: nothing is lost or doubled, keys stay apart, and it comes to an end."""

import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.client import arrow
from tidemap.client.outbox.splitting import MAX_HALVINGS, halves
from tidemap.client.posting import Batch, observation, whole
from tidemap.media_types import ARROW, JSON, NPY


def leaves(batch: Batch) -> list[Batch]:
    """What a batch that is refused whole is sent as in the end, in order."""
    parts = halves(batch)
    return [batch] if parts is None else [leaf for part in parts for leaf in leaves(part)]


def rows(batch: Batch) -> list[tuple[float, int]]:
    """Time and state of each measurement."""
    if batch.content_type == NPY:
        table = np.load(io.BytesIO(batch.content))
        return list(zip(table["time"].tolist(), table["state"].tolist(), strict=True))
    columns = arrow.read_columns(batch.content)
    return list(zip(columns["time"].tolist(), columns["state"].tolist(), strict=True))


@pytest.mark.parametrize("pyarrow", [arrow.pa, None])
@given(times=st.lists(st.integers(0, 30), min_size=1, max_size=60))
def test_the_parts_are_the_batch(pyarrow: object, times: list[int]) -> None:
    kept, arrow.pa = arrow.pa, pyarrow
    try:
        (batch,) = observation("/locations/door", times, [n % 2 for n in range(len(times))]).batches()
        parts = leaves(batch)
        assert [row for part in parts for row in rows(part)] == rows(batch)
        assert [part.measurements for part in parts] == [len(rows(part)) for part in parts]
        assert all(len({time for time, _ in rows(part)}) == 1 for part in parts), "each is of one time"
        assert len({part.key for part in parts}) == len(parts) == len(set(times))
    finally:
        arrow.pa = kept


def test_observations_of_rows_are_split_between_times() -> None:
    cells = [[0, 0], [1, 1], [2, 2]]
    (batch,) = observation("/locations/lab", [0, 60, 60], [1, 0, 1], cells).batches()
    first, second = leaves(batch)
    assert (first.measurements, second.measurements) == (1, 2)
    assert [json.loads(part.content)["observations"][0]["time"] for part in (first, second)] == [0, 60]


def test_a_grid_of_one_time_is_not_split() -> None:
    (batch,) = whole("/locations/lab", 60, np.ones((3, 2))).batches()
    assert halves(batch) is None


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b'{"observations": 3}', b"\x93NUMPY"])
@pytest.mark.parametrize("kind", [NPY, ARROW, JSON, "text/csv"])
def test_what_is_not_known_is_not_split(kind: str, content: bytes) -> None:
    assert halves(Batch("/locations/door", {}, kind, content, "key", 9)) is None


def test_it_comes_to_an_end() -> None:
    (batch,) = observation("/locations/door", list(range(5000)), [1] * 5000).batches()
    parts = leaves(batch)
    assert len(parts) <= 2**MAX_HALVINGS
    assert sum(part.measurements for part in parts) == 5000
