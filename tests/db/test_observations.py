"""The log: numbers, statistics, repeats, and what of it is compacted."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from sqlalchemy import select, update

from tests.support.contexts import history_of, make_location, opened, post_rows
from tests.support.rows import VALUES
from tests.support.truth import Row, measurements_of
from tidemap.history.measurements import Measurements
from tidemap.services.context import Context
from tidemap.services.locations import delete_location, find_location
from tidemap.storage.blobs import pack_measurements, unpack_measurements
from tidemap.storage.records import LocationRecord, ObservationRecord
from tidemap.storage.store import Store
from tidemap.storage.tables import observation


def record_of(rows: list[Row], key: str | None = None, digest: bytes = b"body") -> ObservationRecord:
    measurements = measurements_of(rows)
    times = measurements.time
    payload = pack_measurements(measurements)
    return ObservationRecord(1.0, "robot", len(rows), float(times.min()), float(times.max()), key, digest, payload)


def append(store: Store, location: LocationRecord, rows: list[Row], key: str | None = None) -> int:
    return store.write(lambda work: work.observations.append(location.id, [record_of(rows, key)])) or 0


def now(store: Store, location: LocationRecord) -> LocationRecord:
    with store.read() as work:
        return work.locations.get(location.name)


def test_observations_are_numbered_in_the_order_of_their_commits(store: Store, location: LocationRecord) -> None:
    other = store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    with ThreadPoolExecutor(8) as pool:
        numbers = list(pool.map(lambda n: append(store, location, [(60.0 * n, 0, n % 2)]), range(40)))
        assert append(store, other, [(0.0, 0, 1)]) == 1
    assert sorted(numbers) == list(range(1, 41))
    with store.read() as work:
        stored = {number: float(part.time[0]) for number, part in work.observations.tail(now(store, location)).parts}
    assert stored == {number: 60.0 * n for n, number in enumerate(numbers)}


def test_statistics_follow_early_late_and_repeated_times(store: Store, location: LocationRecord) -> None:
    for rows, first, last, total in (
        ([(500.0, 0, 1), (700.0, 0, 0)], 500.0, 700.0, 2),
        ([(600.0, 0, 1)], 500.0, 700.0, 3),
        ([(-40.5, 0, 1)], -40.5, 700.0, 4),
        ([(1e9, 0, 1), (-1e9, 0, 0)], -1e9, 1e9, 6),
    ):
        append(store, location, rows)
        after = now(store, location)
        assert (after.first_time, after.last_time, after.measurements) == (first, last, total)


def test_a_deleted_location_takes_no_observation(store: Store, location: LocationRecord) -> None:
    store.write(lambda work: work.locations.delete("door"))
    assert append(store, location, [(0.0, 0, 1)]) == 0
    with store.read() as work:
        assert work.observations._connection.execute(select(observation)).all() == []


def test_many_observations_are_appended_at_once(store: Store, location: LocationRecord) -> None:
    append(store, location, [(60.0, 0, 1)])
    looks = [record_of([(60.0 * n, 0, 1), (600.0 - n, 0, 0)], f"k{n}") for n in range(2, 5)]
    assert store.write(lambda work: work.observations.append(location.id, looks)) == 2
    after = now(store, location)
    assert (after.observation_seq, after.measurements, after.first_time, after.last_time) == (4, 7, 60.0, 598.0)
    with store.read() as work:
        assert [number for number, _ in work.observations.tail(after).parts] == [1, 2, 3, 4]


def test_an_idempotency_key_stands_for_one_body_at_one_location(store: Store, location: LocationRecord) -> None:
    other = store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    append(store, location, [(0.0, 0, 1)], "k1")
    append(store, location, [(0.0, 0, 1)])
    append(store, location, [(0.0, 0, 1)])
    with store.read() as work:
        assert work.observations.digests(location.id, ["k1", "k2"]) == {"k1": b"body"}
        assert work.observations.digests(other.id, ["k1"]) == {}
        assert work.observations.digests(location.id, []) == {}


def test_the_tail_is_what_is_not_compacted(store: Store, location: LocationRecord) -> None:
    batches = [[(60.0 * (10 * n + i), 0, i % 2) for i in range(size)] for n, size in enumerate((3, 1, 5, 2))]
    for batch in batches:
        append(store, location, batch)
    with store.read() as work:
        full = work.observations.tail(work.locations.get("door")).parts
        assert [number for number, _ in full] == [1, 2, 3, 4]
        for (_, part), batch in zip(full, batches, strict=True):
            assert [
                (float(t), int(c), int(s)) for t, c, s in zip(part.time, part.cell, part.state, strict=True)
            ] == batch
        for most, count in ((0, 1), (3, 1), (4, 2), (8, 2), (9, 3), (10, 3), (11, 4), (99, 4)):
            packed = work.observations.packed(work.locations.get("door"), most)
            assert [row.number for row in packed] == [1, 2, 3, 4][:count]
            assert [len(row.unpack()) for row in packed] == [row.measurements for row in packed]
    assert store.write(lambda work: work.observations.settle(now(store, location), 2))
    with store.read() as work:
        assert [number for number, _ in work.observations.tail(work.locations.get("door")).parts] == [3, 4]


def test_what_waits_for_compaction_is_counted(store: Store, location: LocationRecord) -> None:
    gate = store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    for size in (3, 1, 5):
        append(store, location, [(60.0 * n, 0, 1) for n in range(size)])
    append(store, gate, [(0.0, 0, 1)])
    store.write(lambda work: work.observations.settle(now(store, gate), 1))
    store.write(lambda work: work.observations.settle(now(store, location), 1))
    with store.read() as work:
        assert work.observations.waiting() == {location.id: 6}


def test_compaction_keeps_the_row_of_an_observation_for_its_key(store: Store, location: LocationRecord) -> None:
    append(store, location, [(0.0, 0, 1)], "k1")
    store.write(lambda work: work.observations.settle(now(store, location), 1))
    with store.read() as work:
        assert work.observations.digests(location.id, ["k1"]) == {"k1": b"body"}
        payloads = work.observations._connection.execute(select(observation.c.payload)).scalars().all()
    assert payloads == [None]


def test_a_damaged_observation_is_named(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    for n in range(2):
        post_rows(ctx, "lab", [(60.0 * n, 1, 1)])
    row = observation.c.id == 2
    ctx.store.write(
        lambda work: work.jobs._connection.execute(update(observation).where(row).values(payload=b"\1short"))
    )
    with ctx.store.read() as work:
        damage = work.observations.tail(work.locations.get("lab")).damage
    assert [str(error)[:51] for error in damage.values()] == ["The stored observation 2 of location 'lab' is corru"]
    assert history_of(ctx, "lab", 0, 0, 2).series(1, 0, 2).tolist() == [1, 2]


def test_observations_of_a_span_are_unpacked_one_after_the_other(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many there are; one that is damaged is left out."""
    make_location(ctx, "lab", (50, 50))
    for n in range(6):
        post_rows(ctx, "lab", [(60.0 * n, n, 1)])
    row = observation.c.id == 4
    ctx.store.write(
        lambda work: work.jobs._connection.execute(update(observation).where(row).values(payload=b"\1short"))
    )
    unpacked = []

    def unpack(payload: bytes, what: str) -> Measurements:
        unpacked.append(what)
        return unpack_measurements(payload, what)

    monkeypatch.setattr("tidemap.storage.repositories.observations.unpack_measurements", unpack)
    with ctx.store.read() as work:
        found = iter(work.observations.pending_between(work.locations.get("lab"), 60.0, 300.0))
        cells = [int(next(found).cell[0])]
        assert len(unpacked) == 1
        cells += [int(each.cell[0]) for each in found]
    assert sorted(cells) == [1, 2, 4]


def test_one_key_through_two_processes_stores_once(ctx: Context, database_url: str) -> None:
    make_location(ctx, "lab", (4, 4))
    with opened(database_url) as other, ThreadPoolExecutor(4) as pool:
        for n in range(12):
            rows = [(60.0 * n, 7, 1)]
            both = [pool.submit(post_rows, each, "lab", rows, idempotency_key=f"k{n}") for each in (ctx, other)]
            assert sorted(each.result().duplicate for each in both) == [False, True]
    assert find_location(ctx, "lab").measurements == 12


def test_history_of_a_new_location_is_not_that_of_a_deleted_one(ctx: Context) -> None:
    for state in (1, 0):
        make_location(ctx, "lab", (50, 50))
        post_rows(ctx, "lab", [(0.0, 7, state)])
        assert history_of(ctx, "lab", 0, 0, 1).series(7, 0, 1).tolist() == [state]
        delete_location(ctx, "lab")


def test_a_stale_record_reads_its_own_tail(ctx: Context) -> None:
    """What a record says about the log bounds what is read for it."""
    make_location(ctx, "lab", (50, 50))
    post_rows(ctx, "lab", [(0.0, 1, 1)])
    location = find_location(ctx, "lab")
    post_rows(ctx, "lab", [(60.0, 1, 1)])
    with ctx.store.read() as work:
        assert [number for number, _ in work.observations.tail(location).parts] == [1]
        assert work.observations.tail(replace(location, compacted_seq=1)).parts == []
