"""The viewer's server: nothing is shared, and news and messages come in handy portions."""

import asyncio
import threading
from functools import reduce
from pathlib import Path

import pytest

from tests.support.contexts import opened
from tests.support.databases import SqliteDatabases
from tests.support.waiting import WAIT_S
from tidemap.errors import TooManyTabsError
from tidemap.events.bus import Bus
from tidemap.events.messages import EventMessage
from tidemap.services.keys import Principal
from tidemap_web.viewer.inner import InnerViser
from tidemap_web.viewer.news import Fresh, News, together
from tidemap_web.viewer.server import ViewerServer
from tidemap_web.viewer.sockets import SendQueue


def test_nobody_can_open_a_tunnel_to_a_public_server() -> None:
    assert InnerViser.request_share_url(object()) is None  # type: ignore[arg-type]


def test_news_are_reported_together() -> None:
    reported: list[Fresh] = []
    enough = threading.Event()

    def report(fresh: Fresh) -> None:
        reported.append(fresh)
        if "last" in fresh:
            enough.set()

    bus, news = Bus(), News(report)
    news.start(bus)
    for number in range(200):
        bus.publish(EventMessage("observation", "lab", number, 0.0))
    bus.publish(EventMessage("anomaly", "lab", 1, 0.0))
    bus.publish(EventMessage("update", "last", 1, 0.0))
    assert enough.wait(WAIT_S)
    assert reduce(together, reported) == {"lab": {"observation", "anomaly"}, "last": {"update"}}
    assert len(reported) <= 3
    news.stop()


def test_one_key_opens_so_many_tabs_and_no_more(tmp_path: Path) -> None:
    with SqliteDatabases(tmp_path).migrated() as url, opened(url, viewer_tabs=2) as ctx:
        viewer = ViewerServer(ctx)
        mine, other = (Principal("ann", "operator", key_id) for key_id in (1, 2))
        first = viewer.open("a" * 16, lambda _: None, mine)
        viewer.open("b" * 16, lambda _: None, mine)
        with pytest.raises(TooManyTabsError, match="2 tabs of the viewer are open"):
            viewer.open("c" * 16, lambda _: None, mine)
        assert not viewer.knows("c" * 16)
        viewer.open("b" * 16, lambda _: None, mine)  # the same tab, again
        viewer.open("d" * 16, lambda _: None, other)
        viewer.close(first)
        viewer.open("c" * 16, lambda _: None, mine)
        viewer.stop()


def test_a_slow_page_gets_the_newest_of_each_kind() -> None:
    async def scenario() -> list[tuple[str, int]]:
        outbox = SendQueue()
        for number in range(5):
            outbox.put({"kind": "frame", "number": number})
        outbox.put({"kind": "location", "number": 9})
        await asyncio.sleep(0)
        read = []
        async for message in outbox.taken():
            read.append((message["kind"], message["number"]))
            if len(read) == 2:
                break
        return read

    assert asyncio.run(scenario()) == [("frame", 4), ("location", 9)]
