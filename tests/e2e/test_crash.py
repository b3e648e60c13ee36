"""Whatever ends the server, what it acknowledged is there, and what it did not can be sent again."""

import time
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect as listen

from tests.support.fleet import RESTLESS, dice, fleet_at_work
from tests.support.forked import Forked
from tests.support.server import StartServer, clean_environment
from tests.support.sightings import LOCATIONS, make_locations
from tests.support.stored import check_stored
from tests.support.waiting import WAIT_S
from tidemap.client import Client

KILLS = 20
MAX_KILL_S = 1.0
STARTING_S = 0.5
"""About what it takes to start."""


@pytest.mark.slow
def test_a_server_killed_twenty_times_has_lost_nothing(server: StartServer, database_url: str, tmp_path: Path) -> None:
    running = server(database_url=database_url, env=RESTLESS)
    make_locations(running.url)
    chance = dice()
    with fleet_at_work(tmp_path, running.url) as fleet:
        for _ in range(KILLS):
            fleet.wait_for_answers(1)
            time.sleep(chance.uniform(0, MAX_KILL_S))
            running.kill()
            running.restart()
        fleet.wait_for_answers(10)
    assert set(fleet.failures) <= {0}
    assert "Traceback" not in running.output()
    fleet.check(running.url, database_url)
    # What was stored while dying can be refitted and compacted like everything else.
    with Client(running.url) as tidemap:
        for name in LOCATIONS:
            assert tidemap.location(name).update(wait=True).state == "done"
    fleet.check(running.url, database_url)
    assert running.stop() == 0


def test_a_server_killed_while_it_makes_its_database(
    server: StartServer, empty_database_url: str, tmp_path: Path
) -> None:
    chance = dice()
    for _ in range(KILLS // 2):
        words = ["serve", "--port", "0", "--database-url", empty_database_url]
        starting = Forked(words, clean_environment(), tmp_path / "log")
        time.sleep(chance.uniform(0, STARTING_S))
        starting.kill()
        starting.wait()
    running = server(database_url=empty_database_url)
    make_locations(running.url)
    check_stored(running.url, empty_database_url, [])
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_a_server_told_to_stop_finishes_what_it_took(server: StartServer, tmp_path: Path) -> None:
    running = server(env=RESTLESS)
    make_locations(running.url)
    with fleet_at_work(tmp_path, running.url) as fleet:
        fleet.wait_for_answers(20)
        assert running.stop() == 0
        running.restart()
        fleet.wait_for_answers(10)
    assert set(fleet.failures) <= {0, 503}
    fleet.check(running.url, f"sqlite:///{running.data / 'tidemap.db'}")


def test_a_listener_does_not_keep_it_from_stopping(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    with listen(f"ws://127.0.0.1:{running.port}/api/v1/events") as socket:
        assert running.stop() == 0
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=WAIT_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code in (1001, 1012)
