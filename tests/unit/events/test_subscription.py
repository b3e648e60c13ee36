"""Subscriptions: only what is wanted, in order, what was missed first, nothing twice, and no end of it for the slow."""

import asyncio
from collections.abc import Awaitable, Callable
from threading import Event, Thread

import pytest

from tests.support.waiting import WAIT_S
from tidemap.api.server_sent import block_of
from tidemap.events.bus import Bus
from tidemap.events.messages import EventMessage, Kind
from tidemap.events.subscription import REPLAY_PAGE, EventFilter, EventStream, Subscription, listen
from tidemap.scope import Scope


def message(number: int, kind: Kind = "anomaly", location: str = "lab") -> EventMessage:
    return EventMessage(kind, location, number, 0.0)


def nothing() -> None:
    pass


async def never(after: int, limit: int) -> list[EventMessage]:
    raise AssertionError("nothing was missed")


@pytest.mark.parametrize(
    ("wanted", "heard"),
    [
        (EventFilter(), [1, 2, 3, 4]),
        (EventFilter(location="lab"), [1, 2]),
        (EventFilter(location="attic"), []),
        (EventFilter(kinds=frozenset({"job", "update"})), [2, 4]),
        (EventFilter("door", frozenset({"job"})), [4]),
        (EventFilter(kinds=frozenset()), []),
    ],
)
def test_only_what_is_wanted_is_heard(wanted: EventFilter, heard: list[int]) -> None:
    bus = Bus()
    numbers: list[int] = []
    end = listen(bus, wanted, lambda each: numbers.append(each.id))
    for each in (message(1), message(2, "update"), message(3, "anomaly", "door"), message(4, "job", "door")):
        bus.publish(each)
    end()
    bus.publish(message(5))
    assert numbers == heard


@pytest.mark.parametrize(
    ("wanted", "resumes"),
    [
        (EventFilter(), False),
        (EventFilter(after=0), True),
        (EventFilter(after=7, kinds=frozenset({"anomaly", "job"})), True),
        (EventFilter(after=7, kinds=frozenset({"job"})), False),
    ],
)
def test_only_anomalies_are_resumed(wanted: EventFilter, resumes: bool) -> None:
    assert wanted.resumes is resumes


def test_messages_wait_in_order_and_wake_their_reader_once() -> None:
    bus = Bus()
    woken: list[int] = []
    with Subscription(bus, EventFilter(), lambda: woken.append(1)) as subscription:
        for number in range(5):
            bus.publish(message(number))
        assert len(woken) == 1
        assert [each.id for each in iter(subscription.take, None)] == [0, 1, 2, 3, 4]
        bus.publish(message(5))
        assert len(woken) == 2
    bus.publish(message(6))
    assert [each.id for each in iter(subscription.take, None)] == [5]


def test_one_too_many_drops_all_and_wakes_the_reader() -> None:
    bus = Bus()
    woken: list[bool] = []
    with Subscription(bus, EventFilter(), lambda: woken.append(subscription.overflowed), limit=2) as subscription:
        bus.publish(message(1))
        bus.publish(message(2))
        bus.publish(message(3))
        bus.publish(message(4))
        assert subscription.overflowed
        assert subscription.take() is None
    assert woken == [False, True]


def test_what_is_taken_makes_room() -> None:
    bus = Bus()
    with Subscription(bus, EventFilter(), nothing, limit=1) as subscription:
        for number in range(10):
            bus.publish(message(number))
            taken = subscription.take()
            assert taken is not None
            assert taken.id == number
        assert not subscription.overflowed


def test_many_threads_publish_to_one_reader() -> None:
    bus, filled = Bus(), Event()
    numbers: list[int] = []
    with Subscription(bus, EventFilter(), filled.set) as subscription:

        def publish(first: int) -> None:
            for number in range(first, 1000, 4):
                bus.publish(message(number))

        threads = [Thread(target=publish, args=(first,)) for first in range(4)]
        for thread in threads:
            thread.start()
        while len(numbers) < 1000:
            assert filled.wait(WAIT_S)
            filled.clear()
            numbers += [each.id for each in iter(subscription.take, None)]
        for thread in threads:
            thread.join()
    assert sorted(numbers) == list(range(1000))
    assert all(numbers.index(n) < numbers.index(n + 4) for n in range(996))


def played(scenario: Callable[[Bus], Awaitable[list[int]]]) -> list[int]:
    async def play() -> list[int]:
        async with asyncio.timeout(WAIT_S):
            return await scenario(Bus())

    return asyncio.run(play())


async def read(stream: EventStream, number: int) -> list[int]:
    return [(await anext(stream)).id for _ in range(number)]


def test_a_stream_follows_the_bus_from_other_threads() -> None:
    async def scenario(bus: Bus) -> list[int]:
        with EventStream(bus, EventFilter(kinds=frozenset({"job"})), 100, never) as stream:

            def publish() -> None:
                for n in range(10):
                    bus.publish(message(n, "job" if n % 2 else "update"))

            thread = Thread(target=publish)
            thread.start()
            numbers = await read(stream, 5)
            thread.join()
            return numbers

    assert played(scenario) == [1, 3, 5, 7, 9]


def test_what_was_missed_comes_first_page_by_page_and_nothing_twice() -> None:
    stored = [message(number) for number in range(1, 2 * REPLAY_PAGE + 11)]
    asked: list[tuple[int, int]] = []

    async def scenario(bus: Bus) -> list[int]:
        async def replay(after: int, limit: int) -> list[EventMessage]:
            asked.append((after, limit))
            page = [each for each in stored if each.id > after][:limit]
            # Some happen while what was missed is read: they are stored, and published too.
            bus.publish(message(len(stored)))
            bus.publish(message(7, "update"))
            return page

        with EventStream(bus, EventFilter(after=5), 100, replay) as stream:
            missed = await read(stream, len(stored) - 5)
            bus.publish(message(len(stored) + 1))
            return [*missed, *await read(stream, len(asked) + 1)]

    numbers = played(scenario)
    last = len(stored)
    assert numbers == [*range(6, last + 1), 7, 7, 7, last + 1]
    assert asked == [(5, REPLAY_PAGE), (5 + REPLAY_PAGE, REPLAY_PAGE), (5 + 2 * REPLAY_PAGE, REPLAY_PAGE)]


def test_what_waits_is_taken_at_once_and_in_order() -> None:
    waited: list[float] = []

    async def scenario(bus: Bus) -> list[int]:
        async def replay(after: int, limit: int) -> list[EventMessage]:
            return [message(1), message(2)] if after < 2 else []

        with EventStream(bus, EventFilter(after=0), 100, replay, waited.append) as stream:
            for number in (2, 3, 4):
                bus.publish(message(number))
            first = await read(stream, 1)
            assert stream.at_hand() == [], "what was missed comes first, one by one"
            rest = await read(stream, 2)
            return first + rest + [each.id for each in stream.at_hand()]

    assert played(scenario) == [1, 2, 3, 4]
    assert len(waited) == 2
    assert min(waited) >= 0


def test_an_anomaly_that_is_known_already_is_not_sent_again() -> None:
    async def scenario(bus: Bus) -> list[int]:
        async def replay(after: int, limit: int) -> list[EventMessage]:
            return []

        with EventStream(bus, EventFilter(after=9), 100, replay) as stream:
            for number in (8, 9, 10):
                bus.publish(message(number))
            return await read(stream, 1)

    assert played(scenario) == [10]


def test_an_anomaly_that_is_known_is_sent_again_when_it_grows() -> None:
    async def scenario(bus: Bus) -> list[int]:
        async def replay(after: int, limit: int) -> list[EventMessage]:
            return []

        with EventStream(bus, EventFilter(after=9), 100, replay) as stream:
            for number, change in ((8, 9), (8, 10), (9, 11), (12, 12)):
                bus.publish(EventMessage("anomaly", "door", number, 0.0, {"change": change}))
            return await read(stream, 3)

    assert played(scenario) == [8, 9, 12]


def test_a_stream_overflows_even_while_its_reader_waits_for_what_it_missed() -> None:
    async def scenario(bus: Bus) -> list[int]:
        async def replay(after: int, limit: int) -> list[EventMessage]:
            await asyncio.Event().wait()
            return []

        with EventStream(bus, EventFilter(after=0), 3, replay) as stream:
            reader = asyncio.create_task(anext(stream))
            await asyncio.sleep(0)
            for number in range(4):
                assert not stream.overflowed.is_set()
                bus.publish(message(number))
            await stream.overflowed.wait()
            reader.cancel()
            return []

    assert played(scenario) == []


def test_a_stream_that_is_closed_hears_no_more() -> None:
    async def scenario(bus: Bus) -> list[int]:
        with EventStream(bus, EventFilter(), 3, never) as stream:
            pass
        for number in range(9):
            bus.publish(message(number))
        await asyncio.sleep(0)
        assert not stream.overflowed.is_set()
        return []

    assert played(scenario) == []


def test_an_update_of_an_anomaly_that_is_known_is_heard() -> None:
    """Also of one from before the reader came: it is news, and a point to resume from."""

    async def listen_in() -> list[tuple[int, bool]]:
        bus = Bus()
        with EventStream(bus, EventFilter(after=7), 9, _none_missed) as stream:
            for number, change in ((7, 7), (3, 8), (9, 9)):
                data = {"update": change > number, "change": change}
                bus.publish(EventMessage("anomaly", "lab", number, 0.0, data))
            return [(each.id, each.data["update"]) for each in [await anext(stream), await anext(stream)]]

    assert asyncio.run(listen_in()) == [(3, True), (9, False)]
    assert block_of(EventMessage("anomaly", "lab", 3, 0.0, {"change": 8})).startswith(b"id: 8\ndata: ")
    assert block_of(EventMessage("update", "lab", 3, 0.0)).startswith(b"data: ")


async def _none_missed(after: int, limit: int) -> list[EventMessage]:
    return []


@pytest.mark.parametrize(
    ("wanted", "heard"),
    [
        (EventFilter(), ["*", "floor-*", "hall"]),
        (EventFilter("floor-2"), ["*", "floor-*"]),
        (EventFilter("hall"), ["*", "hall"]),
        (EventFilter(scope=Scope(("floor-2-*",))), ["*", "floor-*"]),
        (EventFilter(scope=Scope(("attic",))), ["*"]),
        (EventFilter(kinds=frozenset({"anomaly"})), []),
    ],
)
def test_what_concerns_several_locations_is_heard_where_one_is_wanted(wanted: EventFilter, heard: list[str]) -> None:
    said = [message(1, "attention", pattern) for pattern in ("*", "floor-*", "hall")]
    assert [each.location for each in said if wanted.wants(each)] == heard


@pytest.mark.parametrize(("patterns", "heard"), [(None, ["door", "lab"]), (("lab",), ["lab"]), (("do*",), ["door"])])
def test_only_what_is_in_scope_is_heard(patterns: tuple[str, ...] | None, heard: list[str]) -> None:
    wanted = EventFilter(scope=Scope(patterns))
    assert [name for name in ("door", "lab") if wanted.wants(message(1, location=name))] == heard
