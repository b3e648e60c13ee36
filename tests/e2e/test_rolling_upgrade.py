"""A rolling upgrade: the version before goes on serving a database that this one migrates."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from threading import Event, Thread

import pytest
from sqlalchemy import create_engine

from tests.e2e.test_replicas import QUIET, is_leader, wait_for_election
from tests.support.databases import PostgresDatabases
from tests.support.here import command
from tests.support.postgres import Postgres
from tests.support.release_before import ReleaseBefore, commit_before, unpack
from tests.support.server import StartServer
from tests.support.site import Site
from tests.support.waiting import until
from tidemap.storage.migrate import current_version

SEEN = 20


@pytest.fixture
def before(tmp_path: Path) -> ReleaseBefore:
    commit = commit_before()
    if commit is None:
        pytest.skip("git has no history here: the version before the newest migration is not to be had")
    unpack(commit, tmp_path)
    return ReleaseBefore(tmp_path)


@pytest.fixture
def url(postgres: Postgres) -> Iterator[str]:
    """A shared database that nothing has been made in."""
    with PostgresDatabases(postgres).empty() as url:
        yield url


class Robot(Thread):
    """Posts one state after the other to each of some servers, a second apart, until it is stopped."""

    def __init__(self, room: str, *sites: Site) -> None:
        super().__init__()
        self.room, self.sites = room, list(sites)
        self.stored = SEEN
        self.stopping = Event()

    def run(self) -> None:
        for number in count(SEEN):
            if self.stopping.is_set():
                return
            for site in list(self.sites):
                site.observe(self.room, [number + 0.5 * self.sites.index(site)], [0])
                self.stored += 1

    def wait_for_posts(self) -> None:
        """Until some more are stored."""
        enough = self.stored + 5
        until(lambda: self.stored >= enough or not self.is_alive())


def schema(url: str) -> str | None:
    engine = create_engine(url)
    with engine.connect() as connection:
        found = current_version(connection)
    engine.dispose()
    return found


def test_the_version_before_serves_while_and_after_this_one_migrates(
    server: StartServer, before: ReleaseBefore, url: str
) -> None:
    with Site(server(database_url=url, env=QUIET, launch=before)) as old:
        wait_for_election(old.server)
        room, made = old.empty_room(SEEN), schema(url)
        robot = Robot(room, old)
        robot.start()
        robot.wait_for_posts()
        migrated = command("migrate", "--database-url", url)
        assert (migrated.returncode, schema(url) != made) == (0, True), migrated.stderr
        with Site(server(database_url=url, env=QUIET)) as new:
            robot.sites.append(new)
            robot.wait_for_posts()
            assert old.update(room)["state"] == new.update(room)["state"] == "done"
            for site in (old, new):
                assert site.http.get(f"/locations/{room}/state").json()["revision"] == 3
                event = site.observe(room, [1000 + 10 * site.server.port], [1])["anomalies"][0]["id"]
                assert event in old.anomalies(location=room)
                assert event in new.anomalies(location=room)
            robot.sites.remove(old)
            assert old.server.stop() == 0
            until(lambda: is_leader(new.server))
            robot.wait_for_posts()
            robot.stopping.set()
            robot.join()
            assert new.update(room)["state"] == "done"
            facts = new.http.get(f"/locations/{room}").json()
            assert (facts["observations"], facts["revision"]) == (robot.stored + 2, 4)
        assert "Traceback" not in old.server.output()
    verified = command("verify", "--database-url", url)
    assert verified.returncode == 0, verified.stdout
