"""The number that says whether lists of events, and who may see them, are as they were."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.db.test_anomalies import event_of
from tests.db.test_observations import append
from tests.support.rows import VALUES
from tidemap.errors import KeyNotFoundError
from tidemap.storage.records import LocationRecord
from tidemap.storage.store import Store
from tidemap.storage.work import Work

CHANGES: dict[str, Callable[[Work, LocationRecord], Any]] = {
    "event": lambda work, location: work.anomalies.append([event_of(location)]),
    "acknowledged": lambda work, location: work.anomalies.acknowledge(1, "ann", 9.0, None),
    "renamed": lambda work, location: work.locations.change(location.name, {"name": "gate"}),
    "deleted": lambda work, location: work.locations.delete("gate"),
    "key": lambda work, location: work.keys.create("ann", "operator", "tm_", b"hash", 1.0),
    "session": lambda work, location: work.keys.add_session(1, b"hash", 1.0, 2.0),
    "revoked": lambda work, location: work.keys.delete(1),
}


def _made(change: Callable[[Work, LocationRecord], Any], location: LocationRecord, work: Work) -> None:
    change(work, location)


def test_what_lists_of_events_show_counts_and_measurements_do_not(store: Store, location: LocationRecord) -> None:
    numbers = {store.changes.number()}
    for change in CHANGES.values():
        store.write(partial(_made, change, location))
        numbers.add(store.changes.number())
        assert store.changes.number() in numbers
    assert len(numbers) == len(CHANGES) + 1

    other = store.write(lambda work: work.locations.create({**VALUES, "name": "hall"}))
    before = store.changes.number()
    for seconds in range(3):
        append(store, other, [(float(seconds), 0, 1)])
        store.write(lambda work: work.locations.judged(other.id, 9.0))
    assert store.changes.number() == before


def test_a_write_that_failed_leaves_what_others_say_of_theirs(store: Store, location: LocationRecord) -> None:
    def fail(work: Work) -> None:
        work.anomalies.append([event_of(location)])
        raise KeyNotFoundError(1)

    with pytest.raises(KeyNotFoundError):
        store.write(fail)
    before = store.changes.number()
    append(store, location, [(0.0, 0, 1)])
    assert store.changes.number() == before


def test_in_a_file_what_others_store_counts_at_once(store: Store, second: Store, location: LocationRecord) -> None:
    if not store.changes.exact:
        pytest.skip("of PostgreSQL the messages of others say so")
    for _ in range(2):
        before = store.changes.number()
        append(second, location, [(0.0, 0, 1)])
        # Nobody asked between the other's commit and this one: it is not taken for the same.
        append(store, location, [(1.0, 0, 1)])
        assert store.changes.number() != before
    before = store.changes.number()
    append(store, location, [(2.0, 0, 1)])
    assert store.changes.number() == before
    append(second, location, [(3.0, 0, 1)])
    assert store.changes.number() != before


def test_elsewhere_somebody_has_to_say_so(store: Store) -> None:
    before = store.changes.number()
    store.changes.note()
    assert store.changes.number() != before


def test_nothing_is_known_of_a_closed_file(store: Store) -> None:
    store.close()
    assert store.changes.number() is None or not store.changes.exact


def test_a_commit_that_shows_before_it_is_explained_leaves_the_number(
    store: Store, location: LocationRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    meanwhile: list[int | None] = []
    committed = store.changes.committed

    def asked_just_before(connection: Any) -> None:
        meanwhile.append(store.changes.number())
        committed(connection)

    before = store.changes.number()
    monkeypatch.setattr(store.changes, "committed", asked_just_before)
    append(store, location, [(0.0, 0, 1)])
    assert meanwhile == [None if store.changes.exact else before]
    assert store.changes.number() == before
