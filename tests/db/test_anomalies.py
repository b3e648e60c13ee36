"""Anomaly events: ids in the order of commits, filters, acknowledgement."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import Event
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from tests.support.rows import VALUES
from tests.support.waiting import WAIT_S, until
from tidemap.errors import AnomalyNotFoundError
from tidemap.storage.records import AnomalyRecord, LocationRecord
from tidemap.storage.repositories.anomalies import AnomalyFilter
from tidemap.storage.store import Store
from tidemap.storage.work import Work


def event_of(location: LocationRecord, **changes: Any) -> AnomalyRecord:
    event = AnomalyRecord(location.id, 0, 60.0, 120.0, np.array([7, 3]), 1, 0.1, 0.9, 0.8, "surprise", 4)
    return replace(event, **changes)


def ids(store: Store, **wanted: Any) -> list[int]:
    with store.read() as work:
        return [event.id for event in work.anomalies.list(AnomalyFilter(**wanted))]


def test_an_event_comes_back_as_it_was(store: Store, location: LocationRecord) -> None:
    (stored,) = store.write(lambda work: work.anomalies.append([event_of(location)]))
    with store.read() as work:
        found = work.anomalies.get(stored.id)
        assert work.anomalies.latest() == stored.id == 1
    assert found.cells.tolist() == [7, 3]
    assert {**vars(found), "cells": 0} == {**vars(stored), "cells": 0}
    with store.read() as work, pytest.raises(AnomalyNotFoundError):
        work.anomalies.get(2)


def test_nothing_is_stored_of_no_events(store: Store) -> None:
    assert store.write(lambda work: work.anomalies.append([])) == []
    with store.read() as work:
        assert work.anomalies.latest() == 0
        assert work.anomalies.list(AnomalyFilter()) == []


def test_every_filter_leaves_out_what_it_says(store: Store, location: LocationRecord) -> None:
    gate = store.write(lambda work: work.locations.create({**VALUES, "name": "gate"}))
    events = [
        event_of(location, start=0.0, stop=60.0, surprise=0.85),
        event_of(location, start=60.0, stop=120.0, surprise=0.95),
        event_of(gate, start=60.0, stop=180.0, surprise=0.90),
        event_of(location, start=120.0, stop=180.0, surprise=0.99),
    ]
    store.write(lambda work: work.anomalies.append(events))
    store.write(lambda work: work.anomalies.acknowledge(3, "ann", 9.0, None))
    for wanted, expected in (
        ({}, [1, 2, 3, 4]),
        ({"location_id": location.id}, [1, 2, 4]),
        ({"location_id": 99}, []),
        ({"after": 2}, [3, 4]),
        ({"limit": 2}, [1, 2]),
        ({"after": 1, "limit": 2, "location_id": location.id}, [2, 4]),
        ({"start": 60.0}, [2, 3, 4]),
        ({"start": 120.0}, [3, 4]),
        ({"stop": 60.0}, [1]),
        ({"start": 119.0, "stop": 121.0}, [2, 3, 4]),
        ({"min_surprise": 0.9}, [2, 3, 4]),
        ({"acknowledged": True}, [3]),
        ({"acknowledged": False}, [1, 2, 4]),
    ):
        assert ids(store, **wanted) == expected, wanted
    with store.read() as work:
        assert work.locations.open_anomalies() == {location.id: 3}


def acknowledge(by: str, at: float, note: str | None, work: Work) -> AnomalyRecord:
    return work.anomalies.acknowledge(1, by, at, note)


def test_an_acknowledgement_is_kept_and_can_be_replaced(store: Store, location: LocationRecord) -> None:
    store.write(lambda work: work.anomalies.append([event_of(location)]))
    for by, at, note in (("ann", 1.0, "cleaner's trolley"), ("bob", 2.0, None)):
        found = store.write(partial(acknowledge, by, at, note))
        assert (found.acknowledged_by, found.acknowledged_at, found.note) == (by, at, note)
    with pytest.raises(AnomalyNotFoundError):
        store.write(lambda work: work.anomalies.acknowledge(2, "ann", 1.0, None))


def test_an_id_follows_the_commit_not_the_start_of_a_write(
    store: Store, second: Store, location: LocationRecord
) -> None:
    """A writer that takes an id keeps others from taking a later one until its own is visible."""
    taken, go_on = Event(), Event()

    def slow(work: Work) -> int:
        (stored,) = work.anomalies.append([event_of(location)])
        taken.set()
        go_on.wait(WAIT_S)
        return stored.id

    first = store.submit(slow)
    assert taken.wait(WAIT_S)
    other = second.submit(lambda work: work.anomalies.append([event_of(location)])[0].id)
    assert ids(store) == []
    assert not other.done()
    go_on.set()
    assert (first.result(WAIT_S), other.result(WAIT_S)) == (1, 2)


def test_an_acknowledgement_of_what_is_absorbed_meanwhile_is_of_the_older_event(
    store: Store, second: Store, location: LocationRecord
) -> None:
    """Another process waits for the one that makes two events one."""
    store.write(lambda work: work.anomalies.append([event_of(location)] * 3))
    absorbed, go_on = Event(), Event()

    def absorb(work: Work) -> None:
        work.anomalies.absorb(location.id, [3], 2)
        work.anomalies.absorb(location.id, [2], 1)
        absorbed.set()
        go_on.wait(WAIT_S)

    first = store.submit(absorb)
    assert absorbed.wait(WAIT_S)
    other = second.submit(lambda work: work.anomalies.acknowledge(3, "ann", 9.0, "known"))
    until(lambda: waits(store))
    go_on.set()
    first.result(WAIT_S)
    assert (other.result(WAIT_S).id, other.result(WAIT_S).acknowledged_by) == (1, "ann")
    assert ids(store, acknowledged=True) == [1]


def waits(store: Store) -> bool:
    """Whether a transaction waits for another's rows; on SQLite it has not begun, and waits in any case."""
    with store.read() as work:
        if work.anomalies._connection.dialect.name == "sqlite":
            return True
        waiting = text("SELECT count(*) FROM pg_locks WHERE NOT granted AND locktype = 'transactionid'")
        return bool(work.anomalies._connection.execute(waiting).scalar())


@pytest.mark.parametrize("first_of_all", [True, False])
def test_a_reader_who_resumes_by_id_misses_no_event(
    store: Store, second: Store, location: LocationRecord, first_of_all: bool
) -> None:
    """Two writing processes, failing writes among them, and a poller."""
    if not first_of_all:
        store.write(lambda work: work.anomalies.append([event_of(location)]))
    finished = Event()

    def write(n: int) -> list[int]:
        def run(work: Work) -> list[int]:
            stored = work.anomalies.append([event_of(location)] * (1 + n % 3))
            if n % 7 == 3:
                raise ValueError("this write fails after it has taken ids")
            return [event.id for event in stored]

        future = (store, second)[n % 2].submit(run)
        return [] if isinstance(future.exception(WAIT_S), ValueError) else future.result()

    def poll() -> list[int]:
        seen = [0]
        while True:
            last_look = finished.is_set()
            seen += ids(store, after=seen[-1], limit=5)
            if last_look and not ids(store, after=seen[-1]):
                return seen[1:]

    with ThreadPoolExecutor(9) as pool:
        polled = pool.submit(poll)
        try:
            written = [n for numbers in pool.map(write, range(80)) for n in numbers]
        finally:
            finished.set()
        seen = polled.result(WAIT_S)
    assert seen == sorted(set(seen))
    assert sorted(written + ([] if first_of_all else [1])) == seen
