"""The WebSocket of events, on a real server over real sockets."""

import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus

from tests.support.here import command
from tests.support.server import ServerProcess, StartServer
from tests.support.site import Site, heard, listen_for

PROMPT_S = 1.0
TOLD = {"observation": 1, "anomaly": 1, "update": 1, "job": 3}
"""Messages of a surprising observation and an update after it."""


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> Iterator[Site]:
    with Site(shared_server) as made:
        yield made


def test_everything_that_happens_is_told(site: Site) -> None:
    room = site.settled_room()
    with site.events(f"?location={room}") as connection:
        posted = site.observe(room, [100, 101], [1, 1])
        job = site.update(room)
        messages = heard(connection, sum(TOLD.values()))
    assert all({"kind", "location", "id", "time"} <= message.keys() for message in messages)
    assert {message["location"] for message in messages} == {room}
    assert all(message["time"].endswith("Z") for message in messages)
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for message in messages:
        by_kind.setdefault(message["kind"], []).append(message)
    (observation,) = by_kind["observation"]
    assert (observation["id"], observation["measurements"]) == (2, 2)
    (anomaly,) = by_kind["anomaly"]
    assert {name: anomaly[name] for name in posted["anomalies"][0]} == posted["anomalies"][0]
    (update,) = by_kind["update"]
    assert (update["id"], update["estimator"]) == (2, "static")
    assert [message["state"] for message in by_kind["job"]] == ["queued", "running", "done"]
    assert {message["id"] for message in by_kind["job"]} == {job["id"]}


@pytest.mark.parametrize(
    ("query", "kinds"),
    [
        ("?kind=anomaly", {"anomaly"}),
        ("?kind=observation", {"observation"}),
        ("?kind=job", {"job"}),
        ("?kind=update", {"update"}),
        ("?kind=anomaly&kind=update", {"anomaly", "update"}),
        ("?kind=anomaly%7Cjob", {"anomaly", "job"}),
        ("?kind=anomaly,job", {"anomaly", "job"}),
        ("", {"observation", "anomaly", "update", "job"}),
    ],
)
def test_kinds_can_be_chosen(site: Site, query: str, kinds: set[str]) -> None:
    room = site.settled_room()
    with site.events(query) as connection:
        site.observe(room, [100], [1])
        site.update(room)
        assert {message["kind"] for message in heard(connection, sum(TOLD[kind] for kind in kinds))} == kinds


def test_a_location_can_be_chosen(site: Site) -> None:
    room, other = site.empty_room(), site.empty_room()
    with site.events(f"?location={room}&kind=anomaly") as here, site.events("?kind=anomaly") as everywhere:
        site.observe(other, [100], [1])
        site.observe(room, [100], [1])
        assert [message["location"] for message in heard(here, 1)] == [room]
        assert [message["location"] for message in heard(everywhere, 2)] == [other, room]


def test_events_come_within_a_second_of_their_post(site: Site) -> None:
    room = site.empty_room()
    with site.events(f"?location={room}&kind=anomaly") as connection:
        took = []
        for moment in range(100, 130, 2):
            began = time.monotonic()
            posted = site.observe(room, [moment], [1])["anomalies"][0]["id"]
            (message,) = listen_for(connection, 1)
            assert message["id"] == posted
            took.append(time.monotonic() - began)
    assert min(took) < PROMPT_S, "the machine may be busy for a while, not each time"


def test_what_was_missed_is_told_first(site: Site) -> None:
    room = site.empty_room()
    missed = [site.observe(room, [moment], [1])["anomalies"][0]["id"] for moment in range(100, 120, 2)]
    with site.events(f"?location={room}&after={missed[3]}") as connection:
        assert [message["id"] for message in heard(connection, 6)] == missed[4:]
        later = site.observe(room, [200], [1])["anomalies"][0]["id"]
        assert [m["id"] for m in heard(connection, 2) if m["kind"] == "anomaly"] == [later]
    with site.events(f"?location={room}&after={later}&kind=anomaly") as connection:
        assert heard(connection) == []
    with site.events(f"?location={room}&after=0&kind=job") as connection:
        assert heard(connection) == [], "only anomalies are told again"
    with site.events(f"?location={room}") as connection:
        assert heard(connection) == [], "and only when asked for"


class Burglars(threading.Thread):
    """Several of them, occupying a room again and again."""

    def __init__(self, site: Site, room: str, each: int, together: int = 4) -> None:
        super().__init__()
        self._site, self._room, self._each, self._together = site, room, each, together

    def run(self) -> None:
        with ThreadPoolExecutor(self._together) as pool:
            list(pool.map(self._burgle, range(self._together)))

    def _burgle(self, number: int) -> None:
        for i in range(self._each):
            moment = 1000 + 2 * (i * self._together + number)
            self._site.observe(self._room, [moment], [1])


def test_a_dashboard_sees_every_event_exactly_once(site: Site) -> None:
    """Polling by cursor while events are made."""
    room = site.empty_room()
    start = max([*site.anomalies(), 0])
    burglars = Burglars(site, room, each=40)
    burglars.start()
    seen: list[int] = []
    etag = ""
    while True:
        more_to_come = burglars.is_alive()
        query = {"after": seen[-1] if seen else start, "limit": 7}
        answer = site.http.get("/anomalies", params=query, headers={"If-None-Match": etag})
        if answer.status_code == 200:
            etag = answer.headers["etag"]
            seen += [event["id"] for event in answer.json()["items"]]
            if answer.json()["items"]:
                continue
        if not more_to_come:
            break
        time.sleep(0.01)
    burglars.join()
    assert len(seen) == 160
    assert seen == sorted(set(seen)) == site.anomalies(start)


def test_a_listener_that_comes_and_goes_misses_nothing(site: Site) -> None:
    """Every connection takes up behind the last event of the one before, while events are made."""
    room = site.empty_room()
    burglars = Burglars(site, room, each=60)
    burglars.start()
    seen: list[int] = []
    while len(seen) < 240:
        after = seen[-1] if seen else 0
        with site.events(f"?location={room}&kind=anomaly&after={after}") as connection:
            wanted = min(17, 240 - len(seen))
            seen += [message["id"] for message in listen_for(connection, wanted)]
    burglars.join()
    assert seen == site.anomalies(location=room)


def test_a_listener_that_stays_hears_every_event_once_and_in_order(site: Site) -> None:
    room = site.empty_room()
    with site.events(f"?location={room}&kind=anomaly") as connection:
        burglars = Burglars(site, room, each=50)
        burglars.start()
        seen = [message["id"] for message in listen_for(connection, 200)]
        burglars.join()
        assert heard(connection) == []
    assert sorted(seen) == site.anomalies(location=room)
    assert seen == sorted(seen), "so that the last one heard is a place to take up again"


@pytest.mark.parametrize(
    ("query", "status", "says"),
    [
        ("?location=nowhere", 404, "nowhere"),
        ("?location=%00", 404, "no location"),
        ("?kind=gossip", 422, "observation, anomaly, update, job, location"),
        ("?after=x", 422, "after"),
        ("?after=-1", 422, "after"),
        ("?after=" + "9" * 40, 422, "after"),
        ("?colour=red", 422, "colour"),
    ],
)
def test_a_wrong_question_is_refused_in_words(site: Site, query: str, status: int, says: str) -> None:
    with pytest.raises(InvalidStatus) as refused, site.events(query):
        pass
    answer = refused.value.response
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    problem = json.loads(answer.body or b"")
    assert problem["status"] == status
    assert says in problem["detail"]


def test_a_page_of_another_site_may_not_listen(site: Site) -> None:
    """Any page can open a socket to this machine from its visitors' browsers."""
    for origin in ("https://evil.example", "null", f"http://localhost:{site.server.port}"):
        with pytest.raises(InvalidStatus) as refused, site.events(origin=origin):
            pass
        assert refused.value.response.status_code == 403
    with site.events(origin=site.server.url) as connection:
        assert heard(connection) == []


def test_what_a_listener_says_is_not_listened_to(site: Site) -> None:
    room = site.empty_room()
    with site.events(f"?location={room}") as connection:
        connection.send("hello")
        connection.send(b"\0" * 100_000)
        site.observe(room, [100], [0])
        (message,) = heard(connection, 1)
        assert message["kind"] == "observation"


def test_with_keys_a_listener_needs_one(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    secrets = {}
    for role in ("robot", "operator", "admin"):
        made = command("keys", "create", "--role", role, "--data", str(running.data), "--json")
        secrets[role] = json.loads(made.stdout)["key"]
    with Site(running) as site:
        for secret, status in {None: 401, "tm_wrong": 401, secrets["robot"]: 403}.items():
            headers = {"Authorization": f"Bearer {secret}"} if secret else None
            with pytest.raises(InvalidStatus) as refused, site.events(additional_headers=headers):
                pass
            assert refused.value.response.status_code == status
        for role in ("operator", "admin"):
            with site.events(additional_headers={"Authorization": f"Bearer {secrets[role]}"}) as connection:
                assert heard(connection) == []
