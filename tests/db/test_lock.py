"""The lock: one holder at a time, who notices when it is lost, and each time it is taken a later term begins."""

import fcntl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from tests.support.databases import PostgresDatabases, SqliteDatabases
from tests.support.paths import ROOT
from tests.support.postgres import Postgres
from tests.support.waiting import until
from tidemap.errors import NotLeaderError
from tidemap.storage.engine import open_writer
from tidemap.storage.lock import FileLock, Lock, open_lock
from tidemap.storage.store import Store


@pytest.fixture
def sqlite_url(tmp_path: Path) -> Iterator[str]:
    """Of a SQLite database."""
    with SqliteDatabases(tmp_path).migrated() as url:
        yield url


@pytest.fixture
def locks(database_url: str) -> Iterator[tuple[Lock, Lock]]:
    """Of two processes."""
    pair = open_lock(database_url), open_lock(database_url)
    yield pair
    for lock in pair:
        lock.release()


def taken(lock: Lock) -> int:
    """The term, once the database has noticed that nobody holds it."""
    terms: list[int | None] = [None]
    until(lambda: terms.append(lock.take()) or terms[-1] is not None)  # type: ignore[func-returns-value]
    return terms[-1] or 0


def break_lock(url: str, lock: Lock) -> None:
    """Take it away from its holder."""
    if isinstance(lock, FileLock):
        lock._path.unlink()
        return
    engine = open_writer(url)
    with engine.begin() as connection:
        connection.execute(text("SELECT pg_terminate_backend(pid) FROM pg_locks WHERE locktype = 'advisory'"))
    engine.dispose()


def test_one_holds_it_and_the_other_after_it(locks: tuple[Lock, Lock]) -> None:
    mine, other = locks
    first = mine.take()
    assert first is not None
    assert (mine.held(), other.take(), other.held()) == (True, None, False)
    mine.release()
    mine.release()
    assert not mine.held()
    second = taken(other)
    assert second > first
    assert mine.take() is None


def test_its_term_is_the_current_one(locks: tuple[Lock, Lock], store: Store) -> None:
    number = locks[0].take()
    assert number is not None
    store.write(lambda work: work.terms.confirm(number))
    locks[0].release()
    taken(locks[1])
    with pytest.raises(NotLeaderError):
        store.write(lambda work: work.terms.confirm(number))


def test_what_is_left_of_it_is_in_nobodys_way(sqlite_url: str) -> None:
    path = Path(f"{sqlite_url.removeprefix('sqlite:///')}-background")
    lock = open_lock(sqlite_url)
    for _ in range(2):
        path.touch()
        assert lock.take() is not None
        lock.release()
        assert not path.exists()


def test_a_file_that_was_removed_before_it_is_locked_is_no_lock(
    sqlite_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock = fcntl.flock
    path = Path(f"{sqlite_url.removeprefix('sqlite:///')}-background")

    def late(descriptor: int, how: int) -> None:
        path.unlink()
        flock(descriptor, how)

    lock = open_lock(sqlite_url)
    with monkeypatch.context() as patch:
        patch.setattr(fcntl, "flock", late)
        assert lock.take() is None
    assert not lock.held()
    assert lock.take() is not None
    lock.release()


def test_a_holder_notices_that_it_is_lost(locks: tuple[Lock, Lock], database_url: str) -> None:
    mine, other = locks
    first = mine.take()
    break_lock(database_url, mine)
    until(lambda: not mine.held())
    assert first is not None
    assert taken(other) > first
    mine.release()
    assert mine.take() is None
    assert other.held()


HOLDER = """
import sys
from tidemap.storage.lock import open_lock

lock = open_lock(sys.argv[1])
print(lock.take() is not None, flush=True)
sys.stdin.read()
"""


def test_it_is_let_go_by_a_process_that_dies(locks: tuple[Lock, Lock], database_url: str) -> None:
    words = [sys.executable, "-c", HOLDER, database_url]
    with subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "True\n"
        assert locks[0].take() is None
        holder.kill()
    taken(locks[0])


def test_a_database_that_is_away_is_not_locked_and_raises_nothing(tmp_path: Path) -> None:
    lock = open_lock(f"postgresql+psycopg://postgres@/none?host={tmp_path}")
    assert (lock.take(), lock.held()) == (None, False)
    lock.release()


def test_two_databases_and_two_schemas_have_locks_of_their_own(postgres: Postgres) -> None:
    databases = PostgresDatabases(postgres)
    with databases.migrated() as one, databases.migrated() as two:
        engine = open_writer(one)
        with engine.begin() as connection:
            connection.execute(text("CREATE SCHEMA other"))
            connection.execute(text("CREATE TABLE other.counter (LIKE public.counter INCLUDING ALL)"))
        engine.dispose()
        locks = [open_lock(url) for url in (one, two, f"{one}&options=-csearch_path%3Dother")]
        assert all(lock.take() is not None for lock in locks)
        for lock in locks:
            lock.release()
