"""The bus: every listener hears everything once, in order, even when another fails."""

from threading import Thread

import pytest

from tidemap.events.bus import Bus
from tidemap.events.messages import EventMessage


def message(number: int) -> EventMessage:
    return EventMessage("observation", "lab", number, 1.5, {"measurements": 3, "id": "hidden"})


def test_every_listener_hears_every_message_in_order() -> None:
    bus = Bus()
    first: list[EventMessage] = []
    second: list[EventMessage] = []
    bus.subscribe(first.append)
    bus.publish(message(1))
    bus.subscribe(second.append)
    bus.publish(message(2))
    assert [each.id for each in first] == [1, 2]
    assert [each.id for each in second] == [2]


def test_who_unsubscribed_hears_no_more() -> None:
    bus = Bus()
    heard: list[EventMessage] = []
    others: list[EventMessage] = []
    unsubscribe = bus.subscribe(heard.append)
    bus.subscribe(others.append)
    unsubscribe()
    unsubscribe()
    bus.publish(message(1))
    assert heard == []
    assert len(others) == 1


def test_a_listener_that_fails_is_logged_and_keeps_nobody_from_hearing(caplog: pytest.LogCaptureFixture) -> None:
    bus = Bus()
    heard: list[EventMessage] = []

    def fail(_: EventMessage) -> None:
        raise ValueError("deaf")

    bus.subscribe(fail)
    bus.subscribe(heard.append)
    bus.publish(message(1))
    assert len(heard) == 1
    assert "a listener failed" in caplog.text


def test_a_listener_may_unsubscribe_itself_or_subscribe_others_while_it_hears() -> None:
    bus = Bus()
    heard: list[EventMessage] = []

    def once(each: EventMessage) -> None:
        heard.append(each)
        unsubscribe()
        bus.subscribe(heard.append)

    unsubscribe = bus.subscribe(once)
    bus.publish(message(1))
    bus.publish(message(2))
    assert [each.id for each in heard] == [1, 2]


def test_listeners_come_and_go_from_many_threads() -> None:
    bus = Bus()
    heard: list[EventMessage] = []
    bus.subscribe(heard.append)

    def come_and_go() -> None:
        for _ in range(200):
            bus.subscribe(lambda _: None)()
            bus.publish(message(1))

    threads = [Thread(target=come_and_go) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(heard) == 800
    assert len(bus._everyones._all) == 1


def test_what_is_redirected_is_delivered_by_the_outlet_and_counted_as_own_at_once() -> None:
    bus, delivered, own, through = Bus(), list[int](), list[int](), list[EventMessage]()
    bus.subscribe(lambda each: delivered.append(each.id))
    bus.subscribe_own(lambda each: own.append(each.id))
    restore = bus.redirect(through.append)
    bus.publish(message(1))
    bus.deliver(message(2))
    assert (delivered, own) == ([2], [1])
    bus.deliver(through[0])
    restore()
    bus.publish(message(3))
    assert (delivered, own) == ([2, 1, 3], [1, 3])


def test_on_the_wire_what_a_message_adds_never_hides_what_it_is() -> None:
    assert message(7).wire() == {
        "measurements": 3,
        "kind": "observation",
        "location": "lab",
        "id": 7,
        "time": "1970-01-01T00:00:01.500000Z",
    }
