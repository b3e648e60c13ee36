"""Server-Sent Events of a real server: the same messages as over the WebSocket, resumed, bounded, ended."""

import socket as sockets
from collections.abc import Iterator

import httpx
import pytest

from tests.e2e.test_keys import make_key
from tests.e2e.test_slow_listeners import MEMORY_MB, POSTS, Hall
from tests.support.here import command
from tests.support.memory import memory_mb
from tests.support.server import ServerProcess, StartServer
from tests.support.server_sent import event_source
from tests.support.site import Site, listen_for
from tests.support.waiting import WAIT_S, until
from tidemap.media_types import EVENT_STREAM, PROBLEM


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> Iterator[Site]:
    with Site(shared_server) as made:
        yield made


def gauge(site: Site, name: str, transport: str = "sse") -> float:
    """A metric of the server."""
    return site.metric(f'{name}{{transport="{transport}"}}')


def test_both_transports_bring_the_same_messages(site: Site) -> None:
    room = site.settled_room()
    query = f"?location={room}"
    with event_source(site.server.url, query) as source, site.events(query) as connection:
        assert source.headers["content-type"].startswith(EVENT_STREAM)
        assert source.headers["cache-control"] == "private, no-store"
        site.observe(room, [100, 101], [1, 1])
        site.update(room)
        messages = source.take(6)
        assert messages == listen_for(connection, 6)
        assert [message["kind"] for message in messages].count("job") == 3
        (anomaly,) = [message for message in messages if message["kind"] == "anomaly"]
        assert source.last_id == str(anomaly["id"]), "only anomalies are points to resume from"
        assert gauge(site, "tidemap_listeners") == gauge(site, "tidemap_listeners", "websocket") == 1
    until(lambda: gauge(site, "tidemap_listeners") == 0)


@pytest.mark.parametrize("query", ["?kind=anomaly,job", "?kind=anomaly&kind=job", "?kind=anomaly%7Cjob"])
def test_kinds_can_be_chosen(site: Site, query: str) -> None:
    room = site.settled_room()
    with event_source(site.server.url, query) as source:
        site.observe(room, [100], [1])
        site.update(room)
        assert [message["kind"] for message in source.take(4)] == ["anomaly", "job", "job", "job"]


def test_the_last_id_resumes_and_wins_over_after(site: Site) -> None:
    room = site.empty_room()
    ids = [site.observe(room, [moment], [1])["anomalies"][0]["id"] for moment in range(100, 112, 2)]
    query = f"?location={room}&kind=anomaly"
    with event_source(site.server.url, f"{query}&after={ids[3]}") as source:
        assert [message["id"] for message in source.take(2)] == ids[4:]
    with event_source(site.server.url, f"{query}&after={ids[3]}", last_id=str(ids[1])) as source:
        assert [message["id"] for message in source.take(4)] == ids[2:]


def test_a_resume_point_that_is_still_to_come_silences_nothing(site: Site) -> None:
    room = site.empty_room()
    with event_source(site.server.url, f"?location={room}&kind=anomaly&after={10**17}") as source:
        anomaly = site.observe(room, [200], [1])["anomalies"][0]
        assert source.take(1)[0]["id"] == anomaly["id"]


def test_what_happens_before_the_first_message_can_be_resumed(site: Site) -> None:
    room = site.empty_room()
    before = site.observe(room, [100], [1])["anomalies"][0]["id"]
    query = f"?location={room}&kind=anomaly"
    with event_source(site.server.url, query) as source, site.events(query) as connection:
        next(source.lines), next(source.lines)
        positions = [source.headers["Last-Event-ID"], connection.response.headers["Last-Event-ID"]]  # type: ignore[union-attr]
    assert positions == [str(before)] * 2
    missed = site.observe(room, [102], [1])["anomalies"][0]["id"]
    with event_source(site.server.url, query, last_id=positions[0]) as source:
        assert [message["id"] for message in source.take(1)] == [missed]


@pytest.mark.parametrize(
    ("query", "last_id", "status", "says"),
    [
        ("?location=nowhere", None, 404, "nowhere"),
        ("?kind=gossip", None, 422, "observation, anomaly, update, job, location"),
        ("?after=-1", None, 422, "after"),
        ("", "x", 422, "after"),
        ("", "9" * 40, 422, "after"),
        ("?colour=red", None, 422, "colour"),
    ],
)
def test_a_wrong_question_is_refused_in_words(
    site: Site, query: str, last_id: str | None, status: int, says: str
) -> None:
    with pytest.raises(httpx.HTTPStatusError) as refused, event_source(site.server.url, query, last_id):
        pass
    answer = refused.value.response
    assert (answer.status_code, answer.headers["content-type"]) == (status, PROBLEM)
    assert says in answer.json()["detail"]


def test_a_stream_needs_a_key_and_ends_with_it(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    where = ("--data", str(running.data))
    keys = {role: make_key(where, role) for role in ("robot", "operator", "admin")}
    for secret, status in {"": 401, "tm_wrong": 401, keys["robot"]["key"]: 403}.items():
        headers = {"Authorization": f"Bearer {secret}"} if secret else {}
        with (
            pytest.raises(httpx.HTTPStatusError) as refused,
            event_source(running.url, headers=headers),
        ):
            pass
        assert refused.value.response.status_code == status
    headers = {"Authorization": f"Bearer {keys['operator']['key']}"}
    with event_source(running.url, headers=headers) as source:
        assert command("keys", "revoke", str(keys["operator"]["id"]), *where).returncode == 0
        assert list(source) == [], "it ends"
    with httpx.Client(base_url=running.url, trust_env=False) as browser:
        browser.post("/login", data={"key": keys["admin"]["key"]})
        cookie = {"Cookie": f"tidemap_session={browser.cookies['tidemap_session']}"}
        with event_source(running.url, headers=cookie) as source:
            browser.post("/logout", headers=cookie)
            assert list(source) == []


def test_the_server_stops_with_streams_open(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    with event_source(running.url) as source:
        next(source.lines)
        assert running.stop() == 0
        assert list(source) == []
    assert "Cancel" not in running.output()
    assert "Error" not in running.output()


def test_a_stuck_reader_is_dropped_and_slows_nobody(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false", "TIDEMAP_SOCKET_QUEUE": "16"})
    with Site(running) as site:
        hall = Hall(site)
        before = memory_mb(running.process.pid)
        stuck = [_stuck(running.port) for _ in range(3)]
        until(lambda: gauge(site, "tidemap_listeners") == 3)
        with event_source(running.url, "?kind=anomaly") as lively:
            for _ in range(POSTS):
                hall.look()
                assert len(lively.take(1)) == 1
            until(lambda: gauge(site, "tidemap_listeners_dropped_total") == 3)
            until(lambda: gauge(site, "tidemap_listeners") == 1)
            assert memory_mb(running.process.pid) < before + MEMORY_MB
            for each in stuck:
                _read_to_the_end(each)
            hall.look()
            assert len(lively.take(1)) == 1
    assert "ASGI" not in running.output()


def _stuck(port: int) -> sockets.socket:
    """A reader that asks and then never reads."""
    each = sockets.socket()
    each.setsockopt(sockets.SOL_SOCKET, sockets.SO_RCVBUF, 2048)
    each.connect(("127.0.0.1", port))
    each.sendall(f"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    return each


def _read_to_the_end(each: sockets.socket) -> None:
    each.settimeout(WAIT_S)
    try:
        while each.recv(1 << 16):
            pass
    except ConnectionResetError:
        return
    finally:
        each.close()
