"""Segments of the history: they take the place of the log once, and a damaged one hurts no other."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sqlalchemy import select, update

from tests.db.test_observations import append, now
from tests.support.contexts import compact_now, history_of, make_location, post_rows
from tidemap.errors import CorruptChunkError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.segment import Segment
from tidemap.services.compaction import replace_log
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.storage.blobs import pack_segment
from tidemap.storage.records import LocationRecord
from tidemap.storage.store import Store
from tidemap.storage.tables import history, observation
from tidemap.storage.work import Work


def everything(store: Store) -> list[tuple[object, ...]]:
    with store.read() as work:
        connection = work.observations._connection
        return [tuple(row) for table in (history, observation) for row in connection.execute(select(table)).all()]


def test_of_two_compactions_from_one_record_the_second_changes_nothing(store: Store, location: LocationRecord) -> None:
    for n in range(3):
        append(store, location, [(60.0 * n, 0, 1)])
    old = now(store, location)
    mine, theirs = (pack_segment(Segment.empty(1, number)) for number in (0, 1))
    assert store.write(lambda work: replace_log(work, old, 2, {(0, 0): mine}))
    before = everything(store)
    assert not store.write(lambda work: replace_log(work, old, 3, {(0, 0): theirs, (0, 1): theirs}))
    assert everything(store) == before
    assert now(store, location).compacted_seq == 2


def damage(ctx: Context, chunk: int, segment: int) -> None:
    """Flip one bit in the middle of a stored segment."""

    def run(work: Work) -> None:
        connection = work.observations._connection
        mine = (history.c.chunk == chunk) & (history.c.segment == segment)
        payload = bytearray(connection.execute(select(history.c.payload).where(mine)).scalar_one())
        payload[len(payload) // 2] ^= 4
        connection.execute(update(history).where(mine).values(payload=bytes(payload)))

    ctx.store.write(run)


def test_a_damaged_segment_is_named_and_hurts_no_other(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    cells = range(0, 2500, 7)
    post_rows(ctx, "lab", [(60.0 * n, cell, 1) for n in (5, 5000) for cell in cells])
    compact_now(ctx, "lab")
    damage(ctx, chunk=1, segment=0)
    with pytest.raises(
        CorruptChunkError, match="history of location 'lab', chunk 1, segment 0 is corrupt: its checksum"
    ):
        history_of(ctx, "lab", 1, 0, 5001)
    for chunk, start in ((0, 0), (2, 0), (1, 4096)):
        states = history_of(ctx, "lab", chunk, start, 5001).states()
        mine = [cell % CHUNK_CELLS for cell in cells if cell // CHUNK_CELLS == chunk]
        assert np.flatnonzero((states == 1).any(axis=1)).tolist() == mine
    post_rows(ctx, "lab", [(60.0 * 6, 3, 0)])
    assert history_of(ctx, "lab", 0, 0, 10).series(3, 6, 7).tolist() == [0]


def test_two_compactions_at_once_lose_and_double_nothing(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    rows = [(60.0 * n + 0.5, (n * 37) % 2500, n % 2) for n in range(60)]
    with ThreadPoolExecutor(6) as pool:
        posts = [pool.submit(post_rows, ctx, "lab", rows[n : n + 3]) for n in range(0, 60, 3)]
        compactions = [pool.submit(compact_now, ctx, "lab") for _ in range(12)]
        for post in posts:
            post.result()
        for compaction in compactions:
            compaction.result()
    for _ in range(2):
        for chunk in range(3):
            states = history_of(ctx, "lab", chunk, 0, 60).states()
            for _, cell, state in rows:
                if cell // CHUNK_CELLS == chunk:
                    assert state in states[cell % CHUNK_CELLS]
        compact_now(ctx, "lab")
    location = find_location(ctx, "lab")
    assert location.compacted_seq == location.observation_seq == 20
