"""Readers whose connections break at any byte miss nothing and hear nothing twice, over both transports."""

import asyncio
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import chain, repeat
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.cutting import cutting
from tests.support.server import ServerProcess
from tests.support.server_sent import event_source
from tests.support.site import Site
from tests.support.waiting import until
from tidemap.client import AsyncClient, Client, RetryPolicy
from tidemap.schemas.common import parse_time

EVENTS = 30
LAST = 10_000
"""When the last event begins."""
EAGER = RetryPolicy(tries=10_000, first_s=0.001, max_s=0.01)
Heard = list[Mapping[str, Any]]
Read = Callable[[str, str], Heard]
"""The messages that a reader of a server hears of a location's anomalies, up to the last one: (url, location)."""


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> Iterator[Site]:
    with Site(shared_server) as made:
        yield made


def by_client(url: str, room: str) -> Heard:
    """Over the WebSocket, with the client."""
    found: Heard = []
    with Client(url, retry=EAGER) as client:
        for message in client.events(room, "anomaly"):
            found.append(message.data)
            if is_last(message.data):
                break
    return found


def by_event_source(url: str, room: str) -> Heard:
    """Over Server-Sent Events, as a browser reconnects."""
    found: Heard = []
    last_id = None
    while not (found and is_last(found[-1])):
        with suppress(httpx.TransportError), event_source(url, f"?location={room}&kind=anomaly", last_id) as source:
            try:
                last_id = last_id or source.headers["Last-Event-ID"]
                for message in source:
                    found.append(message)
                    if is_last(message):
                        break
            finally:
                # A cut may come between the line with the id and its data.
                last_id = str(found[-1]["change"]) if found else last_id
    return found


def is_last(message: Mapping[str, Any]) -> bool:
    return parse_time(message["start"]) == LAST


both = pytest.mark.parametrize("read", [by_client, by_event_source])


@both
@settings(max_examples=12, suppress_health_check=list(HealthCheck))
@given(cuts=st.lists(st.integers(0, 3000), max_size=30), grows=st.lists(st.integers(0, EVENTS - 1), max_size=30))
def test_connections_that_break_at_any_byte_cost_nothing(
    site: Site, read: Read, cuts: list[int], grows: list[int]
) -> None:
    """Of what happens meanwhile to an event the reader hears the outcome, after all that came before, and once."""
    room = site.empty_room()
    # The first connection lasts until it knows where it stands: what came before is not asked for.
    allowed = chain([1000], cuts, repeat(None))
    stop = {number: 100 + 100 * number for number in range(EVENTS)}
    with cutting(site.server.port, lambda: next(allowed)) as proxy, ThreadPoolExecutor(1) as pool:
        reading = pool.submit(read, proxy.url, room)
        until(lambda: _listeners(site) or proxy.connections > 1)
        for number in [*range(EVENTS), *grows]:
            site.observe(room, [stop[number]], [1])
            stop[number] += 1
        site.observe(room, [LAST], [1])
        heard = reading.result()
    changes = [message["change"] for message in heard]
    assert changes == sorted(set(changes))
    assert sorted(message["id"] for message in heard if not message["update"]) == site.anomalies(location=room)
    outcome = {parse_time(message["start"]): parse_time(message["stop"]) for message in heard}
    assert outcome == {100 + 100 * number: end for number, end in stop.items()} | {LAST: LAST + 1}
    until(lambda: not _listeners(site))


@pytest.mark.parametrize("awaited", [False, True])
def test_the_client_listens_for_ever_where_every_connection_is_ended(site: Site, awaited: bool) -> None:
    """And what happens before the first message is delivered, though nobody was connected then."""
    room = site.empty_room()
    with cutting(site.server.port, lasts_s=0.3) as proxy, ThreadPoolExecutor(1) as pool:
        policy = RetryPolicy(tries=2, first_s=0.01, max_s=0.05)
        reading = pool.submit(_first_awaited if awaited else _first, proxy.url, room, policy)
        until(lambda: proxy.connections > 4 * policy.tries)
        posted = site.observe(room, [100], [1])["anomalies"][0]["id"]
        assert reading.result() == posted


def _first(url: str, room: str, policy: RetryPolicy) -> int | None:
    with Client(url, retry=policy) as client:
        return next(client.events(room, "anomaly")).id


def _first_awaited(url: str, room: str, policy: RetryPolicy) -> int | None:
    async def read() -> int | None:
        async with AsyncClient(url, retry=policy) as client:
            return (await anext(client.events(room, "anomaly"))).id

    return asyncio.run(read())


def _listeners(site: Site) -> float:
    return site.metric("tidemap_listeners{")
