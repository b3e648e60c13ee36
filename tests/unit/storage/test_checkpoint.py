"""SQLite's log file stays short however much is written while there are always readers."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from itertools import count
from pathlib import Path
from random import Random
from threading import Event

import pytest

from tests.support.waiting import WAIT_S
from tidemap.storage.store import Store
from tidemap.storage.work import Work

READERS, WRITERS = 6, 4
MOST = 400_000
WRITTEN = 20_000
"""Bytes of one write; a group of some is one transaction."""


@pytest.fixture
def store(database_url: str) -> Iterator[Store]:
    """One that commits at most four writes together."""
    with closing(Store(database_url, commit_batch=4)) as made:
        yield made


@pytest.fixture
def log(database_url: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The log file, bounded to what a test can fill quickly."""
    monkeypatch.setattr("tidemap.storage.checkpoint.MAX_BYTES", MOST)
    return Path(database_url.removeprefix("sqlite:///") + "-wal")


def write(work: Work) -> None:
    names = f"{Random(time.monotonic_ns()).random():.17f}" + "x" * WRITTEN
    work.keys.create(names, "robot", "tm_", names.encode()[:32], 1.0)


def test_it_is_bounded_under_readers_that_never_pause(store: Store, log: Path) -> None:
    done = Event()
    reads = count()

    def read() -> None:
        while not done.is_set():
            with store.read() as work:
                work.keys.count()
                time.sleep(0.02)
            next(reads)

    def post() -> int:
        largest = 0
        for _ in range(60):
            store.write(write)
            largest = max(largest, log.stat().st_size)
        return largest

    with ThreadPoolExecutor(READERS + WRITERS) as pool:
        reading = [pool.submit(read) for _ in range(READERS)]
        largest = max(pool.map(lambda _: post(), range(WRITERS)))
        done.set()
        for each in reading:
            each.result()
    written = WRITERS * 60 * WRITTEN
    # A write of 20 kB takes 24 kB of pages beside some of the index.
    transaction = 4 * (WRITTEN + 20_000)
    assert written > 5 * (MOST + transaction)
    assert largest <= MOST + transaction
    assert next(reads) > READERS, "the readers went on"


def test_a_reader_that_stays_is_waited_for_a_little_and_then_later_again(
    store: Store, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tidemap.storage.checkpoint.MAX_WAIT_S", 0.05)
    monkeypatch.setattr("tidemap.storage.checkpoint.REST_S", 0.05)
    leave, inside = Event(), Event()

    def stay() -> None:
        with store.read() as work:
            work.keys.count()
            inside.set()
            assert leave.wait(WAIT_S)

    with ThreadPoolExecutor(1) as pool:
        staying = pool.submit(stay)
        assert inside.wait(WAIT_S)
        for _ in range(30):
            store.write(write)
        assert log.stat().st_size > MOST
        leave.set()
        staying.result()
    time.sleep(0.1)
    store.write(write)
    store.write(write)
    assert log.stat().st_size <= MOST
