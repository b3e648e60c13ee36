"""The repository of locations: their rows, and that nothing is left of a deleted one."""

from functools import partial

import numpy as np
import pytest
from sqlalchemy import func, select

from tests.support.contexts import compact_now, make_location, post_rows, refit
from tests.support.rows import VALUES
from tidemap.errors import LocationExistsError, LocationNotFoundError
from tidemap.services.context import Context
from tidemap.services.jobs import request_update
from tidemap.services.locations import delete_location, find_location
from tidemap.services.update import UpdateRequest
from tidemap.storage.records import AnomalyRecord, LocationRecord, RhythmRecord, ScanRecord
from tidemap.storage.store import Store
from tidemap.storage.tables import metadata
from tidemap.storage.work import Work

OWNED = [table for table in metadata.sorted_tables if "location_id" in table.c]


def create(name: str, work: Work) -> LocationRecord:
    """Store one of this name."""
    return work.locations.create({**VALUES, "name": name})


def count_rows(store: Store, location_id: int) -> dict[str, int]:
    """How many rows of a location each table has."""

    def count(work: Work) -> dict[str, int]:
        connection = work.locations._connection
        query = select(func.count())
        return {
            table.name: connection.execute(
                query.select_from(table).where(table.c.location_id == location_id)
            ).scalar_one()
            for table in OWNED
        }

    with store.read() as work:
        return count(work)


def test_what_is_created_is_found(store: Store) -> None:
    grid = '{"frame": "map", "origin": [0.1, 0.2, 0.3], "resolution_m": 0.05, "shape": [3, 4]}'
    made = store.write(lambda work: work.locations.create({**VALUES, "kind": "grid2d", "grid": grid}))
    with store.read() as work:
        found = work.locations.get("door")
    assert found == made
    assert {name: getattr(found, name) for name in VALUES if name != "grid"} == {
        name: value for name, value in VALUES.items() if name != "grid"
    } | {"kind": "grid2d"}
    assert found.grid is not None
    assert (found.grid.origin, found.grid.resolution_m, found.grid.shape) == ((0.1, 0.2, 0.3), 0.05, (3, 4))
    assert (found.observation_seq, found.compacted_seq, found.measurements, found.revision) == (0, 0, 0, 0)
    assert (found.first_time, found.last_time) == (None, None)


def test_a_name_is_taken_once(store: Store) -> None:
    store.write(lambda work: work.locations.create(VALUES))
    with pytest.raises(LocationExistsError, match="'door' exists already"):
        store.write(lambda work: work.locations.create(VALUES))
    store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    with pytest.raises(LocationExistsError):
        store.write(lambda work: work.locations.change("gate", {"name": "door", "confidence": 0.7}))
    with store.read() as work:
        assert work.locations.get("gate").confidence == 0.9


def test_a_change_changes_what_it_names(store: Store) -> None:
    before = store.write(lambda work: work.locations.create(VALUES))
    after = store.write(lambda work: work.locations.change("door", {"name": "gate", "order": 3}))
    assert (after.id, after.name, after.order) == (before.id, "gate", 3)
    assert store.write(lambda work: work.locations.change("gate", {})) == after
    assert store.write(lambda work: work.locations.change("gate", {"name": "gate"})) == after
    with store.read() as work, pytest.raises(LocationNotFoundError, match="no location 'door'"):
        work.locations.get("door")


def test_the_list_is_sorted_and_goes_on_after_a_name(store: Store) -> None:
    for name in ("b", "C", "a", "B-1", "a.2"):
        store.write(partial(create, name))
    with store.read() as work:
        every = [location.name for location in work.locations.list()]
        pages = [location.name for location in work.locations.list(limit=2)]
        while page := [location.name for location in work.locations.list(after=pages[-1], limit=2)]:
            pages += page
    assert sorted(every) == sorted(("b", "C", "a", "B-1", "a.2"))
    assert pages == every


@pytest.mark.parametrize("change", ["get", "delete"])
def test_an_unknown_name_is_said_to_be_unknown(store: Store, change: str) -> None:
    with pytest.raises(LocationNotFoundError):
        store.write(lambda work: getattr(work.locations, change)("attic"))
    with pytest.raises(LocationNotFoundError):
        store.write(lambda work: work.locations.change("attic", {"order": 1}))


def fill(ctx: Context, name: str) -> int:
    """Give a location rows in every table; its id."""
    make_location(ctx, name, (40, 30))
    for n in range(4):
        post_rows(ctx, name, [(n * 60.0, cell, (n + cell) % 2) for cell in (0, 500, 1199)], idempotency_key=f"k{n}")
        if n == 1:
            compact_now(ctx, name)
    ctx.store.write(lambda work: work.sources.keep(find_location(ctx, name).id, 2))
    refit(ctx, name, estimator="static")
    request_update(ctx, name, UpdateRequest())
    with ctx.store.read() as work:
        location = work.locations.get(name)
    event = AnomalyRecord(location.id, 0, 0.0, 60.0, np.array([1, 2]), 1, 0.1, 0.9, 0.9, "surprise", 1)
    scan = ScanRecord(location.id, 0, None, 0.0, 0.0, None, "quarantined", {}, 1, None, None, 1, b"x")
    rhythm = RhythmRecord(location_id=location.id, through=1, heard=b"", last_heard=None, silence=None)
    ctx.store.write(lambda work: (work.anomalies.append([event]), work.scans.append([scan])))
    ctx.store.write(lambda work: work.rhythms.put(rhythm))
    ctx.store.write(lambda work: work.sources.refuse(location.id, "patrol", 0.0, "no such cell"))
    return location.id


def test_nothing_is_left_of_a_deleted_location(ctx: Context) -> None:
    gone, stays = fill(ctx, "lab"), fill(ctx, "hall")
    before = count_rows(ctx.store, stays)
    assert all(before.values()), before
    delete_location(ctx, "lab")
    assert not any(count_rows(ctx.store, gone).values())
    assert count_rows(ctx.store, stays) == before


def test_no_id_is_given_twice(ctx: Context) -> None:
    seen = set()
    for _ in range(3):
        seen.add(fill(ctx, "lab"))
        delete_location(ctx, "lab")
    assert len(seen) == 3
