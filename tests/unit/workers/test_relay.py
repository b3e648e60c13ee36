"""The relay: each process hears what any of them has done, new events exactly once and in the order of their ids."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from sqlalchemy import create_engine

from tests.support.contexts import NOW, make_location, opened, post_states, refit
from tests.support.databases import PostgresDatabases, SqliteDatabases
from tests.support.postgres import Postgres
from tests.support.waiting import until
from tidemap.events.messages import EventMessage
from tidemap.services.context import Context
from tidemap.storage.channel import MAX_TEXT_BYTES, Channel
from tidemap.workers.hints import Hint
from tidemap.workers.relay import Relay, relayed

FREE_S = 7200.0
STEP_S = 120.0
"""Between two visits, so that each is an event of its own."""
END_CONNECTIONS = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE starts_with(query, 'LISTEN')"
END_SENDERS = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE starts_with(query, 'SELECT pg_notify')"


class Process:
    """A context with all that is heard there."""

    def __init__(self, url: str) -> None:
        self._stack = ExitStack()
        self.ctx: Context = self._stack.enter_context(opened(url))
        self.heard: list[EventMessage] = []
        self.ctx.bus.subscribe(self.heard.append)

    def relay(self) -> None:
        """Begin to hear of others."""
        self._stack.enter_context(relayed(self.ctx))

    def visit(self, number: int) -> None:
        """Somebody is in the empty room."""
        post_states(self.ctx, "room", [NOW - FREE_S + STEP_S * number], [1])

    def of_kind(self, kind: str, *, update: bool = False) -> list[int]:
        """The ids of the messages of a kind so far."""
        return [each.id for each in self.heard if each.kind == kind and bool(each.data.get("update")) == update]

    def close(self) -> None:
        """End."""
        self._stack.close()


@pytest.fixture
def url(postgres: Postgres) -> Iterator[str]:
    """A database with a room that was always empty."""
    with PostgresDatabases(postgres).migrated() as url:
        with opened(url) as ctx:
            make_location(ctx, "room", confidence=0.9, event_gap_s=0)
            post_states(ctx, "room", [NOW - FREE_S - 60.0 * minute for minute in range(100, 0, -1)], [0] * 100)
            refit(ctx, "room", estimator="static")
        yield url


@pytest.fixture
def two(url: str) -> Iterator[tuple[Process, Process]]:
    """Two that hear of one another."""
    processes = Process(url), Process(url)
    for each in processes:
        each.relay()
    yield processes
    for each in processes:
        each.close()


def test_each_hears_all_new_events_once_and_in_order(two: tuple[Process, Process]) -> None:
    until(lambda: all(listening(each) for each in two))
    for number in range(40):
        two[number % 2].visit(number)
    ids = list(range(1, 41))
    for each in two:
        until(lambda each=each: len(each.of_kind("anomaly")) >= 40)  # type: ignore[misc]
        assert each.of_kind("anomaly") == ids
        until(lambda each=each: len(each.of_kind("observation")) >= 40)  # type: ignore[misc]
        assert len(each.of_kind("observation")) == 40


def listening(process: Process) -> bool:
    """Whether it hears the others by now."""
    with process.ctx.store.read() as work:
        query = (
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND starts_with(query, 'LISTEN')"
        )
        return bool(work.locations._connection.exec_driver_sql(query).scalar() == 2)


def test_what_was_sent_while_a_connection_was_lost_is_heard_too(
    two: tuple[Process, Process], postgres: Postgres
) -> None:
    first, second = two
    first.visit(0)
    until(lambda: second.of_kind("anomaly"))
    postgres.execute(END_CONNECTIONS)
    for number in range(1, 10):
        first.visit(number)
    until(lambda: len(second.of_kind("anomaly")) >= 10)
    first.visit(10)
    until(lambda: len(second.of_kind("anomaly")) >= 11)
    assert first.of_kind("anomaly") == second.of_kind("anomaly") == list(range(1, 12))


def test_what_cannot_be_sent_is_sent_later(two: tuple[Process, Process], postgres: Postgres) -> None:
    first, second = two
    until(lambda: listening(first))
    for number in (1, 2):
        first.ctx.bus.publish(EventMessage("job", "room", number, NOW))
        until(lambda number=number: number in second.of_kind("job"))  # type: ignore[misc]
        postgres.execute(END_SENDERS)
    first.ctx.bus.publish(EventMessage("job", "room", 3, NOW))
    until(lambda: second.of_kind("job") == [1, 2, 3])


def test_an_event_is_new_though_word_of_its_update_comes_first(two: tuple[Process, Process], url: str) -> None:
    silent, first = Process(url), two[0]
    silent.visit(0)
    silent.close()
    post_states(first.ctx, "room", [NOW - FREE_S + 60.0], [1])
    until(lambda: any(each.kind == "anomaly" for each in first.heard))
    assert first.of_kind("anomaly") == [1]


def test_what_is_no_hint_keeps_none_from_being_heard(two: tuple[Process, Process]) -> None:
    first, second = two
    until(lambda: listening(first))
    first.ctx.bus.publish(EventMessage("job", "room", 1, NOW))
    until(lambda: second.of_kind("job"))
    channel = Channel(first.ctx.settings.url)
    known = Hint.of("another", EventMessage("job", "room", 2, NOW)).text()
    channel.send(["?", "[]", "{}", known.replace("job", "rumour"), known])
    channel.close()
    until(lambda: second.of_kind("job") == [1, 2])
    assert {each.kind for each in second.heard} == {"job"}


def test_an_event_of_a_process_that_sent_no_hint_is_heard(two: tuple[Process, Process], url: str) -> None:
    silent = Process(url)
    silent.visit(0)
    silent.close()
    for each in two:
        until(lambda each=each: each.of_kind("anomaly"))  # type: ignore[misc]
    two[1].visit(1)
    for each in two:
        until(lambda each=each: len(each.of_kind("anomaly")) >= 2)  # type: ignore[misc]
        assert each.of_kind("anomaly") == [1, 2]


def test_what_becomes_of_an_event_and_a_new_revision_is_heard_elsewhere(two: tuple[Process, Process]) -> None:
    first, second = two
    until(lambda: listening(first))
    first.ctx.bus.publish(EventMessage("job", "room", 3, NOW, {"state": "queued"}))
    first.visit(0)
    until(lambda: first.of_kind("anomaly") and second.of_kind("anomaly"))
    post_states(first.ctx, "room", [NOW - FREE_S + 60.0], [1])
    until(lambda: second.of_kind("anomaly", update=True))
    (updated,) = (each for each in second.heard if each.data.get("update"))
    until(lambda: first.of_kind("anomaly", update=True))
    (here,) = (each for each in first.heard if each.data.get("update"))
    assert updated.wire() == here.wire()
    assert second.of_kind("job") == [3]


def test_a_relay_that_has_ended_leaves_the_bus_as_it_was(url: str) -> None:
    process = Process(url)
    relay = Relay(process.ctx)
    relay.start()
    assert relay.alive()
    relay.stop()
    assert not relay.alive()
    process.visit(0)
    assert process.of_kind("anomaly") == [1]
    process.close()


def test_a_relay_ends_though_the_database_does_not_answer(url: str, caplog: pytest.LogCaptureFixture) -> None:
    process = Process(url)
    relay = Relay(process.ctx)
    engine = create_engine(url)
    with engine.begin() as connection:
        relay.start()
        connection.exec_driver_sql("LOCK TABLE anomaly")
        process.ctx.bus.publish(EventMessage("anomaly", "room", 1, NOW, {"update": False}))
        relay.stop()
    assert "without an answer" in caplog.text
    until(lambda: not relay.alive() and not any(each.name == "tidemap-relay" for each in threading.enumerate()))
    relay.stop()
    process.close()
    engine.dispose()


def test_alone_on_sqlite_there_is_none(tmp_path_factory: pytest.TempPathFactory) -> None:
    with SqliteDatabases(tmp_path_factory.mktemp("alone")).migrated() as url, opened(url) as ctx, relayed(ctx):
        heard: list[EventMessage] = []
        ctx.bus.subscribe(heard.append)
        ctx.bus.publish(EventMessage("job", "room", 1, NOW))
        assert [each.id for each in heard] == [1]


def test_a_hint_fits_the_channel_whatever_is_in_the_message() -> None:
    data = {"revision": 3, "selection": ["x" * 10_000], "order": 15}
    hint = Hint.of("me", EventMessage("update", "lab", 3, NOW, data))
    text = hint.text()
    assert len(text.encode()) <= MAX_TEXT_BYTES
    read = Hint.read(text)
    assert read is not None
    assert read.message().data == {"revision": 3, "selection": None, "order": 15}
