"""The history that questions read: what is compacted, and what has come in since."""

import tracemalloc

import pytest

from tests.support.contexts import compact_now, history_of, make_location, opened, post_rows
from tidemap.history.history import UNOBSERVED
from tidemap.history.measurements import Measurements
from tidemap.services import history
from tidemap.services.context import Context
from tidemap.services.history import read_compacted
from tidemap.services.locations import find_location
from tidemap.storage.blobs import unpack_measurements
from tidemap.storage.repositories import observations


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The numbers of the observations that are unpacked."""
    read: list[str] = []
    unpack = unpack_measurements

    def unpack_and_note(payload: bytes, what: str) -> Measurements:
        read.append(what.split()[1])
        return unpack(payload, what)

    monkeypatch.setattr(observations, "unpack_measurements", unpack_and_note)
    return read


def test_of_a_growing_log_only_what_is_new_is_read(ctx: Context, read: list[str]) -> None:
    make_location(ctx, "lab", (80, 40))
    for minute in range(3):
        post_rows(ctx, "lab", [(60.0 * minute, 7, minute % 2), (60.0 * minute, 3000, 1)])
        assert history_of(ctx, "lab", 0, 0, 3).states()[7].tolist() == [0, 1, 0][: minute + 1] + [2] * (2 - minute)
        assert history_of(ctx, "lab", 2, minute, minute + 1).states()[3000 - 2048] == 1
    assert read == ["1", "2", "3"]
    compact_now(ctx, "lab")
    post_rows(ctx, "lab", [(60.0, 7, 0), (120.5, 7, 1)])
    read.clear()
    assert history_of(ctx, "lab", 0, 0, 3).states()[7].tolist() == [0, 1, 1]
    assert read == ["4"]


def test_an_update_leaves_what_others_hold_of_the_log_until_that_is_compacted(ctx: Context) -> None:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(0.0, 7, 1)])
    compact_now(ctx, "lab")
    post_rows(ctx, "lab", [(60.0, 7, 1)])
    assert history_of(ctx, "lab", 0, 0, 2).states()[7].tolist() == [1, 1]
    location = find_location(ctx, "lab")
    held = ctx.caches.tails.latest(location.id)
    assert held is not None
    assert read_compacted(ctx, location, 0, 0, 2).states()[7].tolist() == [1, UNOBSERVED]
    assert ctx.caches.tails.latest(location.id) == held
    compact_now(ctx, "lab")
    assert read_compacted(ctx, location, 0, 0, 2).states()[7].tolist() == [1, 1]
    assert ctx.caches.tails.latest(location.id) is None


def test_a_moment_ago_is_a_part_of_what_is_held_of_now(ctx: Context, read: list[str]) -> None:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(0.0, 7, 0)])
    before = find_location(ctx, "lab")
    post_rows(ctx, "lab", [(60.0, 7, 1)])
    assert history_of(ctx, "lab", 0, 0, 2).states()[7].tolist() == [0, 1]
    read.clear()
    with ctx.store.read() as work:
        tail = history._tail(ctx, work, before, 0)
    assert (tail.time.tolist(), tail.cell.tolist(), tail.state.tolist()) == ([0.0], [7], [0])
    assert read == []


def test_a_log_too_long_to_be_held_is_read_for_the_chunk_alone(database_url: str, read: list[str]) -> None:
    with opened(database_url, history_cache_bytes=2 * 5 * 5) as ctx:
        make_location(ctx, "lab", (80, 40))
        for minute in range(2):
            post_rows(ctx, "lab", [(60.0 * minute, cell, 1) for cell in (7, 1100, 3000)])
        for chunk, cell in ((0, 7), (1, 76), (2, 952)):
            assert history_of(ctx, "lab", chunk, 0, 2).states()[cell].tolist() == [1, 1]
        assert ctx.caches.tails.latest(find_location(ctx, "lab").id) is None
    assert read == ["1", "2"] * 3


def test_of_a_long_history_one_segment_is_unpacked_at_a_time(ctx: Context) -> None:
    """With ranks, which tell apart measurements of one sample, a segment takes 9 MB; of them an answer holds one."""
    n_segments, segment_s = 8, 4096 * 60.0
    make_location(ctx, "lab", (32, 32))
    for i in range(n_segments):
        post_rows(ctx, "lab", [(i * segment_s, 7, 1), (i * segment_s + 10, 8, 1)])
    compact_now(ctx, "lab")
    location = find_location(ctx, "lab")
    tracemalloc.start()
    try:
        states = read_compacted(ctx, location, 0, 0, 4096 * (n_segments - 1) + 1).cells([7, 8]).states()[:, ::4096]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert states.tolist() == [[1] * n_segments] * 2
    assert peak < 50e6
