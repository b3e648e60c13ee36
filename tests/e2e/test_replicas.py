"""Several servers on one database: all answer, and one at a time does the background work, whatever becomes of it."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.support.databases import PostgresDatabases
from tests.support.filling import fill
from tests.support.fleet import RESTLESS, dice, fleet_at_work
from tests.support.here import command
from tests.support.postgres import Postgres
from tests.support.server import ServerProcess, StartServer
from tests.support.sightings import make_locations
from tests.support.site import Site, heard, listen_for
from tests.support.waiting import WAIT_S, until

QUIET = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"}
KILLS = 5
MAX_KILL_S = 1.0
LAB, MEASUREMENTS = (100, 100, 20), 2_000_000
BEGUN = 0.15
"""Progress of an update that has stored some of its chunks."""
Sites = Callable[[str], Site]


@pytest.fixture
def replica(server: StartServer) -> Iterator[Sites]:
    """Starts servers that do only what they are asked for, on the database at a URL."""
    with ExitStack() as stack:
        yield lambda url: stack.enter_context(Site(server(database_url=url, env=QUIET)))


def is_leader(server: ServerProcess) -> bool:
    """Whether a server says that it does the background work."""
    said = httpx.get(f"{server.url}/metrics", trust_env=False, timeout=WAIT_S).text
    (value,) = re.findall(r"^tidemap_background (\S+)$", said, re.MULTILINE)
    return float(value) == 1


def wait_for_election(server: ServerProcess) -> None:
    began = time.monotonic()
    until(lambda: is_leader(server))
    print(f"elected after {time.monotonic() - began:.2f} s")


def job(site: Site, number: int) -> Any:
    return site.http.get(f"/jobs/{number}").json()


def until_begun(site: Site, number: int, progress: float = BEGUN) -> None:
    """Until a job has come so far, and not to its end."""
    until(lambda: job(site, number)["progress"] >= progress)
    assert job(site, number)["state"] == "running"


def check_published(site: Site, number: int, url: str) -> None:
    """A job is done, and what it published is what everybody sees; nothing is lost or doubled."""
    done = job(site, number)
    assert (done["state"], done["progress"]) == ("done", 1.0)
    location = site.http.get("/locations/lab").json()
    assert (location["observations"], location["revision"]) == (MEASUREMENTS, done["result"]["revision"])
    verified = command("verify", "--database-url", url)
    assert verified.returncode == 0, verified.stdout


def two(replica: Sites, url: str) -> tuple[Site, Site]:
    """Two servers, the first is the leader."""
    first = replica(url)
    wait_for_election(first.server)
    return first, replica(url)


def update_begun(site: Site) -> int:
    """The number of an update that takes some seconds and has begun."""
    assert fill(site, "lab", LAB) == MEASUREMENTS
    number: int = site.http.post("/locations/lab/update", json={}).json()["id"]
    until_begun(site, number)
    return number


def test_a_job_is_done_whichever_replica_was_asked(replica: Sites, database_url: str) -> None:
    first, second = two(replica, database_url)
    room = second.empty_room()
    assert not is_leader(second.server)
    assert is_leader(first.server)
    began = time.monotonic()
    assert second.update(room)["state"] == "done"
    print(f"done after {time.monotonic() - began:.2f} s")
    for site in (first, second):
        assert site.http.get(f"/locations/{room}").json()["revision"] == 2
        assert site.http.get(f"/locations/{room}/state", params={"time": 5}).status_code == 200


def test_each_hears_what_was_posted_to_another(replica: Sites, postgres: Postgres) -> None:
    with PostgresDatabases(postgres).migrated() as url:
        first, second = two(replica, url)
        room = second.empty_room()
        with first.events(f"?location={room}&kind=anomaly") as here, second.events(f"?location={room}") as there:
            for number in range(10):
                (first, second)[number % 2].observe(room, [100 + 2 * number], [1])
            ids = [message["id"] for message in listen_for(here, 10)]
            heard_there = heard(there, 20)
        assert ids == first.anomalies(location=room) == sorted(ids)
        assert [each["id"] for each in heard_there if each["kind"] == "anomaly"] == ids
        assert len([each for each in heard_there if each["kind"] == "observation"]) == 10
        counted = [site.metric('tidemap_events_total{kind="anomaly"}') for site in (first, second)]
        assert counted == [5, 5]


def test_one_that_stops_leaves_the_work_to_another(replica: Sites, database_url: str) -> None:
    first, second = two(replica, database_url)
    assert first.server.stop() == 0
    wait_for_election(second.server)
    second.update(second.empty_room())


def test_one_killed_in_an_update_is_replaced_and_the_update_published_once(replica: Sites, database_url: str) -> None:
    first, second = two(replica, database_url)
    number = update_begun(second)
    with second.events("?location=lab") as events:
        first.server.kill()
        wait_for_election(second.server)
        told = listen_for(events, 1)
        until_begun(second, number)
        # Another one begins, and takes no running job away from its process.
        third = replica(database_url)
        assert not is_leader(third.server)
        until(lambda: job(second, number)["finished_at"] is not None)
        told += heard(events, 2)
    published = [message["id"] for message in told if message["kind"] == "update"]
    states = [message["state"] for message in told if message["kind"] == "job"]
    assert states == ["running", "done"]
    assert published == [third.http.get("/locations/lab").json()["revision"]]
    check_published(third, number, database_url)


def test_one_that_was_frozen_does_no_harm_when_it_goes_on(replica: Sites, postgres: Postgres) -> None:
    """PostgreSQL ends its session, another one works, and what it then goes on with is refused."""
    with PostgresDatabases(postgres).migrated() as url:
        first, second = two(replica, url)
        number = update_begun(second)
        os.kill(first.server.process.pid, signal.SIGSTOP)
        try:
            with second.events("?location=lab") as events:
                wait_for_election(second.server)
                listen_for(events, 1)
                until_begun(second, number)
        finally:
            os.kill(first.server.process.pid, signal.SIGCONT)
        until(lambda: not is_leader(first.server))
        until(lambda: job(second, number)["finished_at"] is not None)
        assert is_leader(second.server)
        check_published(first, number, url)
        assert "Traceback" not in first.server.output() + second.server.output()


def test_one_whose_session_is_ended_gives_up_or_begins_anew(replica: Sites, postgres: Postgres) -> None:
    with PostgresDatabases(postgres).migrated() as url:
        first, second = two(replica, url)
        number = update_begun(second)
        postgres.execute("SELECT pg_terminate_backend(pid) FROM pg_locks WHERE locktype = 'advisory' AND granted")
        until(lambda: "no longer" in first.server.output())
        until(lambda: job(second, number)["finished_at"] is not None)
        until(lambda: is_leader(first.server) != is_leader(second.server))
        check_published(second, number, url)


@pytest.mark.slow
def test_whichever_process_is_killed_nothing_is_lost_or_doubled(
    server: StartServer, database_url: str, tmp_path: Path
) -> None:
    servers = [server(database_url=database_url, env=RESTLESS) for _ in range(2)]
    make_locations(servers[0].url)
    chance = dice()
    with fleet_at_work(tmp_path, *(each.url for each in servers)) as fleet:
        for _ in range(KILLS):
            fleet.wait_for_answers(1)
            time.sleep(chance.uniform(0, MAX_KILL_S))
            until(lambda: is_leader(servers[0]) or is_leader(servers[1]))
            killed, other = servers if is_leader(servers[0]) else reversed(servers)
            killed.kill()
            wait_for_election(other)
            killed.restart()
        fleet.wait_for_answers(10)
    assert "Traceback" not in "".join(each.output() for each in servers)
    for each in servers:
        fleet.check(each.url, database_url)
    with Site(servers[1]) as site:
        until(lambda: {job["state"] for job in site.http.get("/jobs?limit=1000").json()["items"]} == {"done"})
