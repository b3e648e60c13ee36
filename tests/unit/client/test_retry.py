"""What is tried again, for how long, and what is not."""

from itertools import islice

import pytest

from tests.unit.client.scripted import Said, Script, scripted
from tidemap.client import AsyncClient, Client, RetryPolicy, TidemapError, UnreachableError
from tidemap.schemas.observations import Accepted

QUICK = RetryPolicy(tries=4, first_s=0.001, max_s=2.0)
STORED = {
    "accepted": 1,
    "duplicate": False,
    "first_time": "1970-01-01T00:00:00Z",
    "last_time": "1970-01-01T00:00:00Z",
    "anomalies": [],
    "revision": 0,
}
BUSY = {"type": "about:blank#queue-full", "title": "Queue full", "status": 503, "detail": "Send this again."}
HANG_UP = Said(hang_up=True)


def observe(script: Script) -> Accepted:
    with Client(script.url, retry=QUICK) as client:
        return client.location("door").observe([0.0], [1])


def keys(script: Script) -> list[str]:
    return [request.headers["Idempotency-Key"] for request in script.received]


@pytest.mark.parametrize(
    "failure", [HANG_UP, Said(503, BUSY), Said(429, BUSY), Said(408, BUSY), Said(502, b"bad gateway")]
)
def test_a_post_is_sent_again_with_the_same_key_and_body(failure: Said) -> None:
    with scripted(failure, failure, Said(201, STORED)) as script:
        assert observe(script).accepted == 1
    assert len(script.received) == 3
    assert len(set(keys(script))) == 1
    assert len({request.content for request in script.received}) == 1


def test_two_calls_have_different_keys() -> None:
    with scripted(Said(201, STORED)) as script:
        observe(script)
        observe(script)
    assert len(set(keys(script))) == 2


def test_retry_after_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("tidemap.client.blocking.time.sleep", slept.append)
    with scripted(Said(503, BUSY, {"Retry-After": "2"}), Said(201, STORED)) as script:
        observe(script)
    assert slept == [0, 2]


def test_a_server_that_asks_for_more_than_the_patience_is_not_waited_for() -> None:
    with scripted(Said(429, BUSY, {"Retry-After": "3600"})) as script, pytest.raises(TidemapError) as caught:
        observe(script)
    assert caught.value.retry_after_s == 3600
    assert len(script.received) == 1


def test_retry_ends_with_the_servers_own_words() -> None:
    with scripted(Said(503, BUSY)) as script, pytest.raises(TidemapError, match="Send this again") as caught:
        observe(script)
    assert (caught.value.status, caught.value.title) == (503, "Queue full")
    assert len(script.received) == QUICK.tries


def test_a_refusal_is_not_tried_again() -> None:
    fields = [{"field": "time", "message": "give a number"}]
    with (
        scripted(Said(422, BUSY | {"status": 422, "errors": fields})) as script,
        pytest.raises(TidemapError) as caught,
    ):
        observe(script)
    assert (caught.value.errors[0].field, caught.value.errors[0].message) == ("time", "give a number")
    assert caught.value.type.endswith("queue-full")
    assert len(script.received) == 1


def test_an_error_that_is_no_problem_document_still_says_what_it_was() -> None:
    with (
        scripted(Said(500, b"<html>oops")) as script,
        pytest.raises(TidemapError, match=r"Internal Server Error \(500\): <html>oops"),
    ):
        observe(script)


def test_what_may_have_been_done_is_not_done_again() -> None:
    with (
        scripted(HANG_UP) as script,
        Client(script.url, retry=QUICK) as client,
        pytest.raises(UnreachableError) as caught,
    ):
        client.create_location("door", interval_s=60)
    assert caught.value.status == 0
    assert caught.value.__cause__ is not None
    assert len(script.received) == 1


def test_what_was_never_sent_is_tried_again() -> None:
    with scripted(Said()) as script:
        pass
    with Client(script.url, retry=QUICK) as client, pytest.raises(UnreachableError, match="locations"):
        client.create_location("door", interval_s=60)


def test_pauses_double_with_jitter_up_to_the_most() -> None:
    pauses = list(islice(RetryPolicy(first_s=1, max_s=8).pauses(), 200))
    for pause, whole in zip(pauses, [1, 2, 4] + [8] * 197, strict=True):
        assert whole / 2 <= pause <= whole
    assert len(set(pauses[3:])) > 100


async def _observe_twice(url: str) -> tuple[Accepted, Accepted]:
    async with AsyncClient(url, retry=QUICK) as client:
        door = client.location("door")
        return await door.observe([0.0], [1]), await door.observe([0.0], [1], idempotency_key="mine")


def test_the_asynchronous_client_is_as_patient() -> None:
    import asyncio

    with scripted(HANG_UP, Said(503, BUSY), Said(201, STORED)) as script:
        first, second = asyncio.run(_observe_twice(script.url))
    assert (first.accepted, second.accepted) == (1, 1)
    assert len(set(keys(script)[:3])) == 1
    assert keys(script)[3] == "mine"
