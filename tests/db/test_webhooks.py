"""The sender of webhooks: nothing is missed, whatever a receiver does; sent again under the same id; by the leader."""

import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest

from tests.support.contexts import at_work, elected, make_location, opened, post_states, refit
from tests.support.fleet import dice
from tests.support.receiver import BREAK, Receiver, receiving
from tests.support.waiting import until
from tidemap.schemas.common import iso, parse_time
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services import delivery
from tidemap.services.acknowledging import acknowledge
from tidemap.services.context import Context
from tidemap.services.locations import delete_location, find_location
from tidemap.services.snoozing import snooze
from tidemap.services.webhooks import (
    change_webhook,
    create_webhook,
    delete_webhook,
    list_deliveries,
    retry_delivery,
)
from tidemap.storage.records import DeliveryRecord
from tidemap.workers import webhooks
from tidemap.workers.webhooks import WebhookSender


@pytest.fixture
def ctx(database_url: str, tmp_path: Path) -> Iterator[Context]:
    """A context on the real clock: receivers refuse what is old."""
    with opened(database_url, time.time, webhooks_private=True, data=tmp_path) as context:  # type: ignore[arg-type]
        yield context


@contextmanager
def sending(ctx: Context) -> Iterator[WebhookSender]:
    with elected(ctx) as election, at_work(WebhookSender(ctx, election)) as sender:
        yield sender


def room(ctx: Context, name: str = "door") -> str:
    """A location that was never occupied."""
    make_location(ctx, name, interval_s=1.0, estimator="static", confidence=0.75)
    post_states(ctx, name, range(20), [0] * 20)
    refit(ctx, name)
    return name


def alarm(ctx: Context, name: str, number: int) -> int:
    """An anomaly; its id."""
    (event,) = post_states(ctx, name, [1000.0 + 100 * number], [1]).anomalies
    return event.id


def subscribe(ctx: Context, receiver: Receiver, scope: Scope = EVERYWHERE) -> int:
    made = create_webhook(ctx, receiver.url, "", scope)
    receiver.secret = made.secret
    return made.record.id


def deliveries(ctx: Context, webhook: int, state: str) -> list[DeliveryRecord]:
    return list_deliveries(ctx, webhook, state, None, 1000)  # type: ignore[arg-type]


def ids(entries: list[tuple[str, dict[str, object]]]) -> set[int]:
    return {message["data"]["id"] for _, message in entries}  # type: ignore[index]


def test_a_receiver_that_fails_at_random_misses_nothing(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delivery, "RETRY_S", (0.0,) * 1000)
    monkeypatch.setattr(webhooks, "POLL_S", 0.01)
    chance, door = dice(), room(ctx)
    with receiving(lambda: chance.choice([200, 204, 302, 404, 429, 500, 503, BREAK])) as receiver:
        webhook = subscribe(ctx, receiver)
        posted: list[int] = []
        # Senders come and go in the midst of it, as where another process takes over.
        for part in range(4):
            with sending(ctx):
                posted += [alarm(ctx, door, 10 * part + number) for number in range(10)]
                wanted = chance.randrange(len(posted)) if part < 3 else len(posted)
                until(lambda: len(ids(receiver.accepted)) >= wanted)  # noqa: B023
        # What arrived just when the last of them ended is sent again.
        with sending(ctx):
            until(lambda: not deliveries(ctx, webhook, "waiting"))
    assert ids(receiver.accepted) == set(posted)
    names: dict[int, set[str]] = defaultdict(set)
    for name, message in receiver.came:
        names[message["data"]["id"]].add(name)
    assert {len(each) for each in names.values()} == {1}, "an id stays through all attempts"
    assert len(set.union(*names.values())) == len(posted)
    assert deliveries(ctx, webhook, "failed") == []
    assert {each.anomaly_id for each in deliveries(ctx, webhook, "delivered")} == set(posted)


def test_what_becomes_of_an_event_is_sent_in_its_order(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each change under an id of its own, whatever fails; what changes before it is sent goes with it."""
    monkeypatch.setattr(delivery, "RETRY_S", (0.0,) * 1000)
    monkeypatch.setattr(webhooks, "POLL_S", 0.01)
    chance, door = dice(), room(ctx)
    with receiving(lambda: chance.choice([200, 204, 500, BREAK])) as receiver:
        subscribe(ctx, receiver)
        events = {alarm(ctx, door, number): 1000.0 + 100 * number for number in range(3)}
        for _ in range(3):
            with sending(ctx):
                for _ in range(8):
                    grown = chance.choice(list(events))
                    events[grown] += 1
                    post_states(ctx, door, [events[grown]], [1])
        with sending(ctx):
            until(lambda: stops(receiver) == events)
    for id_ in events:
        mine = [(name, each["data"]) for name, each in receiver.came if each["data"]["id"] == id_]
        assert [each["change"] for _, each in mine] == sorted(each["change"] for _, each in mine)
        names = list(dict.fromkeys(name for name, _ in mine))
        assert [name for name, _ in groupby(name for name, _ in mine)] == names, (
            "none before the one before has its end"
        )
        updates = [{each["update"] for name, each in mine if name == message} for message in names]
        assert updates == [{False}, *[{True}] * (len(names) - 1)]


def stops(receiver: Receiver) -> dict[int, float]:
    """In which second each event was seen last, as far as a receiver has heard."""
    return {id_: parse_time(each["stop"]) - 1 for id_, each in latest(receiver).items()}


def latest(receiver: Receiver) -> dict[int, dict[str, Any]]:
    """What a receiver has heard last of each event."""
    return {message["data"]["id"]: message["data"] for _, message in receiver.accepted}


def test_a_change_while_a_delivery_is_under_way_is_sent_after_it(ctx: Context) -> None:
    door = room(ctx)
    with receiving(lambda: _grow(ctx, door)) as receiver, sending(ctx):
        subscribe(ctx, receiver)
        number = alarm(ctx, door, 0)
        until(lambda: latest(receiver).get(number, {}).get("stop") == iso(1002.0))
    assert [each["data"]["stop"] for _, each in receiver.accepted] == [iso(1001.0), iso(1002.0)]


def _grow(ctx: Context, door: str) -> int:
    """A receiver that takes its time: meanwhile the event grows, and that is looked at."""
    if find_location(ctx, door).last_time != 1001.0:
        post_states(ctx, door, [1001.0], [1])
        delivery.add_due(ctx, 1)
    return 204


def test_nothing_is_sent_of_what_is_snoozed_until_it_is_over(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as receiver, sending(ctx):
        subscribe(ctx, receiver)
        quiet, loud = alarm(ctx, door, 0), alarm(ctx, door, 1)
        until(lambda: ids(receiver.accepted) == {quiet, loud})
        snooze(ctx, quiet, "ann", ctx.clock() + 1000)
        post_states(ctx, door, [1001.0], [1])
        post_states(ctx, door, [1101.0], [1])
        until(lambda: latest(receiver)[loud]["stop"] == iso(1102.0))
        assert latest(receiver)[quiet]["stop"] == iso(1001.0)
        snooze(ctx, quiet, "ann", None)
        until(lambda: latest(receiver)[quiet]["stop"] == iso(1002.0))


def test_an_acknowledgement_is_sent_as_a_change_of_the_event(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as receiver, sending(ctx):
        subscribe(ctx, receiver)
        number = alarm(ctx, door, 0)
        until(lambda: ids(receiver.accepted) == {number})
        acknowledge(ctx, number, "ann", "the cleaner")
        until(lambda: latest(receiver)[number]["acknowledged_by"] == "ann")
    assert latest(receiver)[number]["update"]


def test_what_fails_is_tried_ever_more_rarely_and_put_aside(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    door = room(ctx)
    status = 500
    with receiving(lambda: status) as receiver, sending(ctx):
        webhook = subscribe(ctx, receiver)
        alarm(ctx, door, 1)
        (waiting,) = until(lambda: [each for each in deliveries(ctx, webhook, "waiting") if each.attempts])
        assert (waiting.attempts, waiting.status) == (1, 500)
        assert waiting.error == "the receiver answered 500"
        assert delivery.RETRY_S[0] <= waiting.next_at - ctx.clock() + 60 <= delivery.RETRY_S[0] * 1.1 + 60
        monkeypatch.setattr(delivery, "RETRY_S", (0.0,) * 3)
        ctx.store.write(lambda work: work.webhooks.change_delivery(waiting.id, next_at=0.0))
        (failed,) = until(lambda: deliveries(ctx, webhook, "failed"))
        assert (failed.attempts, failed.message_id) == (4, waiting.message_id)
        status = 204
        retry_delivery(ctx, webhook, failed.id)
        (delivered,) = until(lambda: deliveries(ctx, webhook, "delivered"))
        assert (delivered.message_id, delivered.attempts) == (waiting.message_id, 1)
    assert len(receiver.came) == 5


def test_a_receiver_that_hangs_holds_up_no_other(ctx: Context) -> None:
    door = room(ctx)

    def hang() -> int:
        until(lambda: len(quick.accepted) == 3)
        return 204

    with receiving() as quick, receiving(hang) as slow, sending(ctx):
        for each in (slow, quick):
            subscribe(ctx, each)
        posted = {alarm(ctx, door, number) for number in range(3)}
        until(lambda: len(slow.accepted) == 3)
    assert ids(quick.accepted) == ids(slow.accepted) == posted


def test_only_what_a_webhook_is_for_is_sent_and_a_pause_loses_nothing(ctx: Context) -> None:
    door, yard = room(ctx), room(ctx, "yard-gate")
    alarm(ctx, yard, 0)
    with receiving() as receiver, sending(ctx):
        webhook = subscribe(ctx, receiver, Scope(("yard-*",)))
        alarm(ctx, door, 1)
        first = alarm(ctx, yard, 1)
        until(lambda: len(receiver.accepted) == 1)
        change_webhook(ctx, webhook, {"enabled": False})
        second = alarm(ctx, yard, 2)
        change_webhook(ctx, webhook, {"enabled": True})
        until(lambda: len(receiver.accepted) == 2)
        assert ids(receiver.accepted) == {first, second}
        message = receiver.accepted[0][1]
        assert (message["type"], message["data"]["location"]) == ("anomaly", "yard-gate")


def test_a_receiver_that_is_gone_is_left_alone(ctx: Context) -> None:
    door = room(ctx)
    with receiving(lambda: 410) as receiver, sending(ctx):
        webhook = subscribe(ctx, receiver)
        alarm(ctx, door, 1)
        assert until(lambda: deliveries(ctx, webhook, "failed"))
        with ctx.store.read() as work:
            assert not work.webhooks.get(webhook).enabled


def test_a_webhook_that_is_gone_is_left_no_deliveries(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as receiver:
        webhook = subscribe(ctx, receiver)
        alarm(ctx, door, 1)
        delete_webhook(ctx, webhook)
        delivery.add_due(ctx, webhook)
        with ctx.store.read() as work:
            assert work.webhooks.waiting(webhook) == 0


def one_batch(ctx: Context, webhook: int) -> None:
    """What is due is sent until its thread is for another receiver."""
    with elected(ctx) as election:
        until(lambda: election.term)
        sender = WebhookSender(ctx, election)
        sender._round()
        sender._busy[webhook].result()
        sender.stop()


@pytest.mark.parametrize("change", [lambda ctx, it: change_webhook(ctx, it, {"enabled": False}), delete_webhook])
def test_a_webhook_that_is_ended_is_not_sent_the_rest(ctx: Context, change: Callable[[Context, int], Any]) -> None:
    door = room(ctx)

    def end() -> int:
        if not receiver.came:
            change(ctx, webhook)
        return 204

    with receiving(end) as receiver:
        webhook = subscribe(ctx, receiver)
        for number in range(3):
            alarm(ctx, door, number)
        one_batch(ctx, webhook)
        assert len(receiver.came) == 1


def test_the_rest_goes_to_the_new_url_at_once(ctx: Context) -> None:
    door = room(ctx)

    def move() -> int:
        change_webhook(ctx, webhook, {"url": new.url})
        return 410

    with receiving(move) as old, receiving() as new:
        webhook = subscribe(ctx, old)
        new.secret = old.secret
        posted = [alarm(ctx, door, number) for number in range(3)]
        one_batch(ctx, webhook)
        assert len(old.came) == 1
        assert ids(new.accepted) == set(posted[1:]), "and what the old one answered does not end the new one"


def test_of_a_location_that_is_out_of_scope_by_now_nothing_is_sent(ctx: Context) -> None:
    door, yard = room(ctx), room(ctx, "yard-gate")

    def narrow() -> int:
        change_webhook(ctx, webhook, {"scope": Scope(("yard-*",))})
        return 204

    with receiving(narrow) as receiver:
        webhook = subscribe(ctx, receiver)
        first, _, third = alarm(ctx, door, 1), alarm(ctx, door, 2), alarm(ctx, yard, 3)
        one_batch(ctx, webhook)
        assert [message["data"]["id"] for _, message in receiver.came] == [first, third]
        assert deliveries(ctx, webhook, "waiting") == []


def test_a_receiver_that_does_not_answer_has_its_thread_for_one_attempt(ctx: Context) -> None:
    door = room(ctx)
    with receiving(lambda: BREAK) as receiver:
        webhook = subscribe(ctx, receiver)
        posted = {alarm(ctx, door, number) for number in range(2)}
        one_batch(ctx, webhook)
        assert len(receiver.came) == 1
        one_batch(ctx, webhook)
        assert ids(receiver.came) == posted
        assert [each.attempts for each in deliveries(ctx, webhook, "waiting")] == [1, 1]


def test_a_receiver_that_wants_no_more_is_sent_no_more(ctx: Context) -> None:
    door = room(ctx)
    with receiving(lambda: 410) as receiver:
        webhook = subscribe(ctx, receiver)
        for number in range(3):
            alarm(ctx, door, number)
        one_batch(ctx, webhook)
        assert len(receiver.came) == 1
        assert len(deliveries(ctx, webhook, "waiting")) == 2


def test_redirects_are_not_followed(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as other, receiving(lambda: 302, {"Location": other.url}) as receiver, sending(ctx):
        webhook = subscribe(ctx, receiver)
        alarm(ctx, door, 1)
        (waiting,) = until(lambda: [each for each in deliveries(ctx, webhook, "waiting") if each.attempts])
        assert waiting.status == 302
    assert other.came == []


def test_another_key_signs_nothing(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as receiver, sending(ctx):
        webhook = subscribe(ctx, receiver)
        ctx.settings.secret_path.write_bytes(b"A" * 43 + b"=")
        alarm(ctx, door, 1)
        (waiting,) = until(lambda: [each for each in deliveries(ctx, webhook, "waiting") if each.attempts])
        assert waiting.status is None
        assert "not the one that this webhook was made with" in str(waiting.error)
    assert receiver.came == []


def test_of_a_location_that_is_gone_nothing_is_sent(ctx: Context) -> None:
    door = room(ctx)
    with receiving() as receiver:
        webhook = subscribe(ctx, receiver)
        number = alarm(ctx, door, 1)
        ctx.store.write(lambda work: work.webhooks.add_deliveries(webhook, {number: ("msg_x", False)}, number, 0.0))
        delete_location(ctx, door)
        with sending(ctx):
            until(lambda: not deliveries(ctx, webhook, "waiting"))
        assert receiver.came == []


def test_more_than_may_wait_waits_in_its_own_table(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delivery, "MAX_WAITING", 2)
    door = room(ctx)
    with receiving() as receiver:
        webhook = subscribe(ctx, receiver)
        posted = {alarm(ctx, door, number) for number in range(random.randint(5, 9))}
        delivery.add_due(ctx, webhook)
        assert len(deliveries(ctx, webhook, "waiting")) == 2
        with sending(ctx):
            until(lambda: len(receiver.accepted) == len(posted))
    assert ids(receiver.accepted) == posted


def test_an_event_that_became_part_of_another_is_not_sent(ctx: Context) -> None:
    name = room(ctx)
    with receiving() as receiver:
        webhook = subscribe(ctx, receiver)
        first, _ = alarm(ctx, name, 0), alarm(ctx, name, 1)
        delivery.add_due(ctx, webhook)
        between = [1000.0 + number for number in range(1, 100)]
        (event,) = post_states(ctx, name, between, [1] * len(between)).anomalies
        assert event.id == first
        with sending(ctx):
            until(lambda: len(deliveries(ctx, webhook, "delivered")) == 1 and not deliveries(ctx, webhook, "waiting"))
        assert ids(receiver.came) == {first}
