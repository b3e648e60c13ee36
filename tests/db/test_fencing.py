"""Fencing tokens: writes of a term that has ended are refused, and a new term waits for what is under way."""

from concurrent.futures import ThreadPoolExecutor, wait
from threading import Event

import pytest
from sqlalchemy import select

from tests.support.waiting import WAIT_S
from tidemap.errors import NotLeaderError
from tidemap.storage.counters import take
from tidemap.storage.store import Store
from tidemap.storage.tables import counter
from tidemap.storage.work import Work


def begin(store: Store) -> int:
    return store.write(lambda work: work.terms.begin())


def taken(store: Store) -> int:
    """How often `count` was stored."""
    with store.read() as work:
        query = select(counter.c.value).where(counter.c.name == "tries")
        return int(work.terms._connection.execute(query).scalar() or 0)


def count(work: Work) -> int:
    return take(work.terms._connection, "tries")


def in_term(store: Store, number: int) -> Store:
    return store.guarded(lambda work: work.terms.confirm(number))


def test_every_term_has_a_later_number(store: Store) -> None:
    numbers = [begin(store) for _ in range(3)]
    assert numbers == sorted(set(numbers))


def test_only_the_latest_is_confirmed(store: Store) -> None:
    with store.read() as work, pytest.raises(NotLeaderError):
        work.terms.confirm(1)
    first, second = begin(store), begin(store)
    with pytest.raises(NotLeaderError):
        store.write(lambda work: work.terms.confirm(first))
    store.write(lambda work: work.terms.confirm(second))


def test_a_guarded_store_writes_in_its_term_alone(store: Store) -> None:
    mine = in_term(store, begin(store))
    mine.write(count)
    mine.submit(count).result(WAIT_S)
    assert taken(store) == 2
    later = in_term(store, begin(store))
    for write in (mine.write, lambda run: mine.submit(run).result(WAIT_S)):
        with pytest.raises(NotLeaderError):
            write(count)
    assert taken(store) == 2
    later.write(count)
    store.write(count)
    assert taken(store) == 4


def test_what_a_guard_refuses_takes_nothing_else_along(store: Store) -> None:
    old = in_term(store, begin(store))
    begin(store)
    go_on = Event()
    held = store.submit(lambda work: go_on.wait(WAIT_S))
    refused, stored = old.submit(count), store.submit(count)
    go_on.set()
    assert held.result(WAIT_S)
    with pytest.raises(NotLeaderError):
        refused.result(WAIT_S)
    assert stored.result(WAIT_S) == 1
    assert taken(store) == 1


def test_a_term_begins_after_the_writes_of_the_one_before(store: Store, database_url: str) -> None:
    """Else they would be stored in the midst of it."""
    mine = in_term(store, begin(store))
    other = Store(database_url)
    confirmed, go_on = Event(), Event()

    def slow(work: Work) -> int:
        confirmed.set()
        assert go_on.wait(WAIT_S)
        return count(work)

    try:
        with ThreadPoolExecutor(1) as pool:
            writing = mine.submit(slow)
            assert confirmed.wait(WAIT_S)
            beginning = pool.submit(begin, other)
            early = wait([beginning], 0.5).done
            go_on.set()
            assert not early
            writing.result(WAIT_S)
            beginning.result(WAIT_S)
            assert taken(store) == 1
    finally:
        go_on.set()
        other.close()
