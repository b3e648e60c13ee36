"""How much was observed when: what history says, compacted or not, whole or of some of its chunks."""

from typing import Any

import numpy as np
import pytest

from tests.support.contexts import NOW, compact_now, make_location, post_rows
from tidemap.errors import InvalidInputError
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.services import density as module
from tidemap.services.context import Context
from tidemap.services.density import Density, DensityQuery, density
from tidemap.services.locations import find_location
from tidemap.storage.repositories.segments import SegmentRepository
from tidemap.storage.tables import history

MINUTE = 60.0
BEGIN = (NOW // (4096 * MINUTE) - 3) * 4096 * MINUTE + 3000 * MINUTE
SHAPE = (30, 40, 2)


def count(ctx: Context, name: str = "lab", **query: Any) -> Density:
    return density(ctx, find_location(ctx, name), DensityQuery(**query), lambda: None)


def sightings() -> list[tuple[float, int, int]]:
    """What is seen of some cells at a time, now and then, over two segments; each cell once a sample."""
    rng = np.random.default_rng(5)
    minutes = rng.choice(3000, 40, replace=False)
    return [
        (BEGIN + MINUTE * minute, int(cell), int(cell % 2))
        for minute in sorted(minutes.tolist())
        for cell in rng.choice(2400, 20, replace=False)
    ]


def test_it_counts_what_history_holds_before_and_after_it_is_compacted(ctx: Context) -> None:
    make_location(ctx, "lab", SHAPE)
    rows = sightings()
    late = [(BEGIN + 200.5 * MINUTE, 7, 1), (BEGIN + 2000.5 * MINUTE, 1500, 0)]
    rows = [row for row in rows if row[:2] not in {(BEGIN + 200 * MINUTE, 7), (BEGIN + 2000 * MINUTE, 1500)}]
    post_rows(ctx, "lab", rows)
    query: dict[str, Any] = {"start": BEGIN, "stop": BEGIN + 3000 * MINUTE, "bins": 7}
    expected = np.histogram([t for t, _, _ in rows + late], BEGIN + 429 * MINUTE * np.arange(8))[0].tolist()
    post_rows(ctx, "lab", late)
    before = count(ctx, **query)
    compact_now(ctx, "lab")
    after = count(ctx, **query)
    for found in (before, after):
        assert found.measurements.tolist() == expected
        assert found.time.tolist() == (BEGIN + 429 * MINUTE * np.arange(7)).tolist()
        assert (found.step_s, found.step_samples, found.n_counted) == (429 * MINUTE, 429, 2400)
    minutes = np.unique([np.floor((t - BEGIN) / MINUTE) for t, _, _ in rows + late])
    assert after.samples.tolist() == np.histogram(minutes, 429 * np.arange(8))[0].tolist()
    whole = count(ctx)
    assert whole.measurements.sum() == len(rows + late)
    assert len(whole.time) <= 200


def test_of_a_very_large_map_some_chunks_stand_for_all(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    make_location(ctx, "lab", SHAPE)
    rows = sightings()
    post_rows(ctx, "lab", rows)
    compact_now(ctx, "lab")
    post_rows(ctx, "lab", [(t + 3000 * MINUTE, cell, state) for t, cell, state in rows])
    monkeypatch.setattr(module, "MAX_BLOBS", 4)
    found = count(ctx, bins=1)
    assert found.n_counted == 2400 - CHUNK_CELLS
    counted = sum(cell // CHUNK_CELLS != 1 for _, cell, _ in rows)
    assert found.measurements.tolist() == [2 * counted]


def test_what_is_damaged_is_not_counted_and_what_is_empty_is_empty(ctx: Context) -> None:
    make_location(ctx, "door", None)
    assert count(ctx, "door").time.tolist() == []
    make_location(ctx, "lab", SHAPE)
    post_rows(ctx, "lab", [(BEGIN, cell, 0) for cell in (0, CHUNK_CELLS, CHUNK_CELLS + 1)])
    compact_now(ctx, "lab")
    ctx.store.write(lambda work: _damage(work.segments))
    assert count(ctx).measurements.tolist() == [2]
    assert count(ctx, start=BEGIN + 10 * MINUTE, stop=BEGIN + 20 * MINUTE, bins=2).measurements.tolist() == [0, 0]
    with pytest.raises(InvalidInputError, match="swap"):
        count(ctx, start=BEGIN, stop=BEGIN - 1)


def _damage(segments: SegmentRepository) -> None:
    connection = segments._connection
    connection.execute(history.update().where(history.c.chunk == 0).values(payload=b"\x01 nothing like it"))
