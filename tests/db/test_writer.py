"""The one writer: groups, failures inside a group and of a whole one, limits, and the end."""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Event, current_thread
from typing import Any

import pytest
from sqlalchemy import Connection, Engine, event, insert, select, text

from tests.db.test_locations import create
from tests.db.test_observations import record_of
from tests.support.waiting import WAIT_S
from tidemap.errors import (
    DomainError,
    InvalidInputError,
    KeyNotFoundError,
    QueueFullError,
    ShuttingDownError,
    StorageUnavailableError,
)
from tidemap.storage.engine import open_reader, open_writer
from tidemap.storage.gate import Gate
from tidemap.storage.records import LocationRecord
from tidemap.storage.store import Store
from tidemap.storage.tables import api_key
from tidemap.storage.work import Work
from tidemap.storage.writer import Writer

Run = Callable[[Work], Any]


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    """What the writer writes to."""
    made = open_writer(database_url)
    yield made
    made.dispose()


@pytest.fixture
def writer(engine: Engine) -> Iterator[Writer]:
    """A writer with room for eight."""
    made = Writer(engine, queue_length=8, batch=4, gate=Gate())
    yield made
    made.close()


def key(name: str) -> Run:
    """A write that stores a key; its result is the name."""
    return lambda work: work.keys.create(name, "robot", "tm_", name.encode(), 1.0).name


def names(url: str) -> list[str]:
    """The keys that a reader sees."""
    engine = open_reader(url)
    with engine.connect() as connection:
        found = list(connection.execute(select(api_key.c.name).order_by(api_key.c.id)).scalars())
    engine.dispose()
    return found


@contextmanager
def held(writer: Writer) -> Iterator[None]:
    """While the writer is busy with one write, others wait and so become one group."""
    begun, go_on = Event(), Event()

    def block(_: Work) -> None:
        begun.set()
        go_on.wait(WAIT_S)

    blocking = writer.submit(block)
    assert begun.wait(WAIT_S)
    try:
        yield
    finally:
        go_on.set()
        blocking.exception(WAIT_S)


def submit_together(writer: Writer, *runs: Run) -> list[Future[Any]]:
    """Writes that go into one group."""
    with held(writer):
        futures = [writer.submit(run) for run in runs]
    wait(futures, WAIT_S)
    return futures


def submit_for_ever(writer: Writer) -> None:
    while True:
        with suppress(QueueFullError):
            writer.submit(lambda _: None)


def refuse(error: BaseException) -> Run:
    """A write that stores something and then fails."""

    def run(work: Work) -> None:
        work.keys.create("never", "robot", "tm_", b"never", 1.0)
        raise error

    return run


def test_waiting_writes_share_a_commit(writer: Writer, engine: Engine, database_url: str) -> None:
    commits: list[Connection] = []
    event.listen(engine, "commit", commits.append)
    futures = submit_together(writer, *(key(f"k{n}") for n in range(7)))
    assert [future.result() for future in futures] == [f"k{n}" for n in range(7)]
    # The one that held up the others, then two groups of at most four.
    assert len(commits) == 3
    assert names(database_url) == [f"k{n}" for n in range(7)]


def test_a_result_is_known_only_once_others_see_it(writer: Writer, engine: Engine, database_url: str) -> None:
    seen_before_commit = []
    event.listen(engine, "commit", lambda _: seen_before_commit.append((names(database_url), future.done())))
    with held(writer):
        future = writer.submit(key("door"))
    assert future.result(WAIT_S) == "door"
    assert names(database_url) == ["door"]
    assert seen_before_commit[-1] == ([], False)


@pytest.mark.parametrize("error", [KeyNotFoundError(1), ValueError("odd"), KeyboardInterrupt(), SystemExit(2)])
def test_a_failing_write_harms_no_other_of_its_group(writer: Writer, database_url: str, error: BaseException) -> None:
    before, bad, after = submit_together(writer, key("before"), refuse(error), key("after"))
    assert (before.result(), after.result()) == ("before", "after")
    assert bad.exception() is error
    assert names(database_url) == ["before", "after"]
    assert writer.submit(key("later")).result(WAIT_S) == "later"


def test_what_the_database_refuses_harms_no_other_of_its_group(
    writer: Writer, database_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    def twice(work: Work) -> None:
        for _ in range(2):
            work.keys.create("twice", "robot", "tm_", b"twice", 1.0)

    before, bad, after = submit_together(writer, key("before"), twice, key("after"))
    assert (before.result(), after.result()) == ("before", "after")
    assert isinstance(bad.exception(), StorageUnavailableError)
    assert names(database_url) == ["before", "after"]
    assert "a write was refused by the database" in caplog.text


def test_what_follows_a_write_comes_in_the_order_of_the_commits_and_before_its_result(
    writer: Writer, database_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    followed: list[tuple[str, list[str], bool]] = []

    def follow(name: str) -> None:
        followed.append((name, names(database_url), futures[int(name)].done()))
        if name == "1":
            raise ValueError("what follows is broken")

    with held(writer):
        futures = [writer.submit(key("0"), follow), writer.submit(key("1"), follow)]
        futures += [writer.submit(refuse(ValueError("odd")), follow), writer.submit(key("3"), follow)]
        assert futures[3].cancel()
        futures.append(writer.submit(key("4"), follow))
    wait(futures, WAIT_S)
    stored = ["0", "1", "4"]
    assert followed == [(name, stored, False) for name in stored]
    assert futures[1].result() == "1"
    assert "what follows a write failed" in caplog.text


def test_a_cancelled_write_is_not_run(writer: Writer, database_url: str) -> None:
    with held(writer):
        first, second = writer.submit(key("first")), writer.submit(key("second"))
        assert first.cancel()
    assert second.result(WAIT_S) == "second"
    assert names(database_url) == ["second"]


def test_a_full_queue_refuses_and_goes_on_later(writer: Writer, database_url: str) -> None:
    with held(writer):
        futures = [writer.submit(key(f"k{n}")) for n in range(8)]
        assert writer.waiting() == 8
        with pytest.raises(QueueFullError):
            writer.submit(key("too many"))
    wait(futures, WAIT_S)
    assert writer.submit(key("last")).result(WAIT_S) == "last"
    assert names(database_url) == [*(f"k{n}" for n in range(8)), "last"]


def test_closing_finishes_what_was_taken_and_takes_no_more(engine: Engine, database_url: str) -> None:
    writer = Writer(engine, queue_length=8, batch=4, gate=Gate())
    with ThreadPoolExecutor(1) as pool:
        with held(writer):
            futures = [writer.submit(key(f"k{n}")) for n in range(8)]
            closing = pool.submit(writer.close)
            with pytest.raises(ShuttingDownError):
                submit_for_ever(writer)
        closing.result(WAIT_S)
    assert all(future.done() for future in futures)
    assert names(database_url) == [f"k{n}" for n in range(8)]
    writer.close()
    with pytest.raises(ShuttingDownError):
        writer.submit(key("late"))


@pytest.mark.parametrize("step", ["begin", "commit"])
@pytest.mark.parametrize("error", [RuntimeError("odd"), KeyboardInterrupt(), MemoryError()])
def test_a_group_that_cannot_be_stored_fails_as_a_whole_and_the_writer_goes_on(
    writer: Writer, engine: Engine, database_url: str, step: str, error: BaseException
) -> None:
    broken = True

    def fail(_: Connection) -> None:
        if broken:
            raise error

    with held(writer):
        futures = [writer.submit(key(f"k{n}")) for n in range(3)]
        event.listen(engine, step, fail)
    wait(futures, WAIT_S)
    errors = [future.exception() for future in futures]
    assert all(isinstance(each, StorageUnavailableError) for each in errors)
    assert len(set(map(id, errors))) == 3, "an error that threads share would share their traces"
    assert names(database_url) == []
    broken = False
    assert writer.submit(key("later")).result(WAIT_S) == "later"
    assert names(database_url) == ["later"]


def only_on(engine: Engine, dialect: str) -> None:
    if engine.dialect.name != dialect:
        pytest.skip(f"says something about {dialect} alone")


def test_two_processes_in_each_others_way_both_get_through(database_url: str) -> None:
    """Groups that take the same rows in opposite order: PostgreSQL ends one of them after a second."""
    stores = Store(database_url), Store(database_url)
    locations = [stores[0].write(partial(create, f"d{n}")) for n in range(2)]

    def append(location: LocationRecord, then: Event | None = None) -> Run:
        def run(work: Work) -> int | None:
            number = work.observations.append(location.id, [record_of([(0.0, 0, 1)])])
            if then is not None:
                then.wait(0.3)
            return number

        return run

    pause = Event()
    futures = [store.submit(append(location, pause)) for store, location in zip(stores, locations, strict=True)]
    futures += [store.submit(append(location)) for store, location in zip(stores, reversed(locations), strict=True)]
    assert sorted(future.result(WAIT_S) for future in futures) == [1, 1, 2, 2]
    for store in stores:
        store.close()


def disconnect_all_others(engine: Engine) -> None:
    with engine.connect() as connection:
        rest = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = current_database()"
        connection.execute(text(f"{rest} AND pid <> pg_backend_pid()"))


@pytest.mark.parametrize("when", ["between", "within", "at the end of"])
def test_a_lost_connection_fails_a_group_at_most(
    writer: Writer, engine: Engine, database_url: str, when: str, caplog: pytest.LogCaptureFixture
) -> None:
    only_on(engine, "postgresql")
    other = open_writer(database_url)

    def lose(_: Work | None = None) -> None:
        disconnect_all_others(other)

    assert writer.submit(key("first")).result(WAIT_S) == "first"
    if when == "between":
        lose()
        # A dead connection is found and replaced before it is used.
        assert writer.submit(key("second")).result(WAIT_S) == "second"
    else:
        futures = submit_together(writer, key("a"), lose, *([key("b")] if when == "within" else []))
        assert all(isinstance(future.exception(), StorageUnavailableError) for future in futures)
        assert "the database cannot be written" in caplog.text
    assert writer.submit(key("third")).result(WAIT_S) == "third"
    assert names(database_url) == ["first", *(["second"] if when == "between" else []), "third"]
    other.dispose()


def test_a_full_disk_loses_nothing_that_was_acknowledged(
    writer: Writer, engine: Engine, database_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    """SQLite may end the whole transaction when the disk is full, savepoints and all."""
    only_on(engine, "sqlite")

    def limit(pages: int) -> Run:
        return lambda work: work.keys._connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")

    def large(work: Work) -> None:
        rows = [
            {"name": "large", "role": "robot", "prefix": "tm_", "created_at": 1.0, "hash": bytes([n] * 9000)}
            for n in range(99)
        ]
        for row in rows:
            work.keys._connection.execute(insert(api_key).values(**row))

    with engine.connect() as connection:
        pages = int(connection.exec_driver_sql("PRAGMA page_count").scalar_one())
        connection.exec_driver_sql("PRAGMA cache_size = 5")
    writer.submit(limit(pages + 4)).result(WAIT_S)
    futures = submit_together(writer, key("before"), large, key("after"))
    stored = [future.result() for future in futures if future.exception() is None]
    assert isinstance(futures[1].exception(), StorageUnavailableError)
    assert names(database_url) == stored
    assert "database or disk is full" in caplog.text
    assert writer.submit(key("small")).result(WAIT_S) == "small"
    writer.submit(limit(2**30)).result(WAIT_S)
    writer.submit(large).result(WAIT_S)
    assert names(database_url) == [*stored, "small", *["large"] * 99]


def test_a_disk_that_cannot_be_written_refuses_until_it_can(writer: Writer, engine: Engine, database_url: str) -> None:
    only_on(engine, "sqlite")

    def read_only(on: int) -> None:
        connection = engine.raw_connection()
        connection.cursor().execute(f"PRAGMA query_only = {on}")
        connection.close()

    writer.submit(key("a")).result(WAIT_S)
    read_only(1)
    for name in "bc":
        assert isinstance(writer.submit(key(name)).exception(WAIT_S), StorageUnavailableError)
    read_only(0)
    assert writer.submit(key("d")).result(WAIT_S) == "d"
    assert names(database_url) == ["a", "d"]


def test_another_process_that_writes_is_waited_for(writer: Writer, engine: Engine, database_url: str) -> None:
    only_on(engine, "sqlite")
    other = open_writer(database_url)
    with other.begin() as connection:
        future = writer.submit(key("second"))
        connection.execute(insert(api_key).values(name="first", role="r", prefix="p", hash=b"1", created_at=1.0))
        assert not future.done()
    assert future.result(WAIT_S) == "second"
    assert names(database_url) == ["first", "second"]
    other.dispose()


def test_a_store_reads_what_it_wrote(store: Store) -> None:
    assert store.write(key("door")) == "door"
    assert store.submit(key("gate")).result(WAIT_S) == "gate"
    with store.read() as work:
        assert [each.name for each in work.keys.list(None, None)] == ["door", "gate"]


def test_a_reader_sees_one_moment(store: Store) -> None:
    store.write(key("door"))
    with store.read() as work:
        assert work.keys.count() == 1
        store.write(key("gate"))
        assert work.keys.count() == 1
    with store.read() as work:
        assert work.keys.count() == 2


def test_every_request_that_runs_finds_a_connection(store: Store) -> None:
    with ExitStack() as stack:
        for _ in range(40):
            assert stack.enter_context(store.read()).keys.count() == 0


def test_a_lost_connection_fails_one_read(
    store: Store, engine: Engine, database_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    only_on(engine, "postgresql")

    def lose_and_count() -> None:
        with store.read() as work:
            work.keys.count()
            disconnect_all_others(engine)
            work.keys.count()

    with pytest.raises(StorageUnavailableError):
        lose_and_count()
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.startswith("the database cannot be read: ")
    assert "\n" not in said
    with store.read() as work:
        assert work.keys.count() == 0


def test_who_reads_on_after_the_end_is_told_so(database_url: str) -> None:
    store = Store(database_url)
    store.close()
    with pytest.raises(ShuttingDownError), store.read():
        raise AssertionError("it was read")


def test_a_writer_rests_as_long_as_it_is_told(store: Store) -> None:
    store.write(key("before"))
    store.slow_down(0.2)
    began = time.monotonic()
    for number in range(3):
        store.write(key(f"slow {number}"))
    assert time.monotonic() - began >= 0.4
    store.slow_down(0)


def test_a_read_that_fails_leaves_no_connection_behind(store: Store) -> None:
    def fail() -> None:
        with store.read() as work:
            work.keys.delete(work.keys.count())

    for _ in range(100):
        with pytest.raises(KeyNotFoundError):
            fail()
    assert store._reader.pool.checkedout() == 0  # type: ignore[attr-defined]


def test_a_log_file_that_readers_kept_open_is_emptied_when_they_let_go(
    store: Store, engine: Engine, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    only_on(engine, "sqlite")
    monkeypatch.setattr("tidemap.storage.checkpoint.MAX_BYTES", 50_000)
    monkeypatch.setattr("tidemap.storage.checkpoint.MAX_WAIT_S", 0.001)
    monkeypatch.setattr("tidemap.storage.checkpoint.REST_S", 0.0)
    log = Path(database_url.removeprefix("sqlite:///") + "-wal")
    with store.read() as work:
        work.keys.count()
        for number in range(20):
            store.write(key(f"held {number}"))
        assert log.stat().st_size > 50_000
    store.write(key("after"))
    store.write(key("and after its care"))
    assert log.stat().st_size < 50_000


def test_items_beside_each_other_are_written_at_once_and_each_refused_for_itself(
    writer: Writer, database_url: str
) -> None:
    calls: list[list[str]] = []

    def make_all(work: Work, wanted: Sequence[str]) -> list[str | DomainError]:
        calls.append(list(wanted))
        return [key(name)(work) if name != "refused" else KeyNotFoundError(7) for name in wanted]

    with held(writer):
        futures: list[Future[Any]] = [writer.submit_item(make_all, name) for name in ("a", "refused")]
        futures += [writer.submit(key("b")), writer.submit_item(make_all, "c")]
    assert [future.exception(WAIT_S) is None for future in futures] == [True, False, True, True]
    assert isinstance(futures[1].exception(), KeyNotFoundError)
    assert calls == [["a", "refused"], ["c"]]
    assert names(database_url) == ["a", "b", "c"]


def test_an_item_that_fails_takes_no_other_along(writer: Writer, database_url: str) -> None:
    def make_all(work: Work, wanted: Sequence[str]) -> list[str]:
        made = [key(name)(work) for name in wanted]
        if "bad" in wanted:
            raise ValueError
        return made

    with held(writer):
        futures = [writer.submit_item(make_all, name) for name in ("a", "bad", "b")]
    assert [type(future.exception(WAIT_S)) for future in futures] == [type(None), ValueError, type(None)]
    assert names(database_url) == ["a", "b"]


def test_items_are_made_in_the_writers_thread_before_their_group_and_once(writer: Writer, database_url: str) -> None:
    made: list[tuple[str, str, list[str]]] = []

    def make(name: str) -> str:
        made.append((name, current_thread().name, names(database_url)))
        if name == "odd":
            raise InvalidInputError.at("name", "is odd")
        return name

    def make_all(work: Work, wanted: Sequence[str]) -> list[str]:
        stored = [key(name)(work) for name in wanted]
        if "bad" in wanted:
            raise ValueError
        return stored

    with held(writer):
        futures = [writer.submit_deferred(make_all, partial(make, name)) for name in ("a", "odd", "gone", "bad", "b")]
        assert futures[2].cancel()
    assert [type(future.exception(WAIT_S)) for future in futures if not future.cancelled()] == [
        type(None),
        InvalidInputError,
        ValueError,
        type(None),
    ]
    assert made == [(name, "tidemap-writer", []) for name in ("a", "odd", "bad", "b")]
    assert names(database_url) == ["a", "b"]
