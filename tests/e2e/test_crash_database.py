"""However the database ends under the server, it comes back by itself, and nothing acknowledged is lost or doubled."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.databases import PostgresDatabases
from tests.support.fleet import RESTLESS, dice, fleet_at_work
from tests.support.postgres import Postgres, running_postgres
from tests.support.server import StartServer
from tests.support.sightings import make_locations
from tests.support.site import Site
from tests.support.waiting import until

ENDS = [signal.SIGKILL, signal.SIGINT, signal.SIGKILL, signal.SIGQUIT, signal.SIGKILL]
MAX_KILL_S = 0.8


@pytest.fixture
def mortal() -> Iterator[Postgres]:
    """A database server that survives its own death. Only that of the machine would need the disk to be waited for."""
    with running_postgres({"fsync": "off"}) as server:
        yield server


def test_a_database_that_dies_and_comes_back(server: StartServer, mortal: Postgres, tmp_path: Path) -> None:
    chance = dice()
    with (
        PostgresDatabases(mortal).migrated() as url,
        Site(server(database_url=url, env=RESTLESS)) as site,
    ):
        make_locations(site.server.url)
        with fleet_at_work(tmp_path, site.server.url) as fleet:
            for how in chance.sample(ENDS, len(ENDS)):
                fleet.wait_for_answers(5)
                time.sleep(chance.uniform(0, MAX_KILL_S))
                refused = len(fleet.failures)
                mortal.end(how)
                # Who worked for it may outlive it for a moment.
                until(lambda: site.http.get("/locations/door").status_code == 503)
                answer = site.http.get("/locations/door")
                assert answer.json()["type"] == "urn:tidemap:problem:storage-unavailable"
                assert "retry-after" in answer.headers
                until(lambda refused=refused: len(fleet.failures) > refused)  # type: ignore[misc]
                mortal.start()
            fleet.wait_for_answers(5)
        until(lambda: {job["state"] for job in site.http.get("/jobs?limit=1000").json()["items"]} == {"done"})
        assert set(fleet.failures) == {503}
        fleet.check(site.server.url, url)
        assert "Traceback" not in site.server.output()
        assert site.server.stop() == 0
