"""The demo against a real server process: seeded once, told what went wrong, living on."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import WAIT_S, until
from tidemap.client import Client, RetryPolicy
from tidemap.demo import live
from tidemap.demo.locations import BUILDING, FORMS, LOCATIONS, MIN_CELLS, NotTheDemoError
from tidemap.demo.posting import Posted
from tidemap.demo.robot import INTERVAL_S
from tidemap.demo.seed import phases, seed
from tidemap.demo.story import planted
from tidemap.progress import Silent

HOUR_S = 3600.0


@dataclass
class Seeded:
    """A seeded server. `now` is the time up to which it is seeded."""

    process: ServerProcess
    client: Client
    now: float
    posted: Posted
    took_s: float


@pytest.fixture(scope="module")
def seeded(shared_server: ServerProcess) -> Iterator[Seeded]:
    now = time.time() - 2 * HOUR_S
    with Client(shared_server.url) as client:
        began = time.monotonic()
        posted = seed(client, now, Silent())
        yield Seeded(shared_server, client, now, posted, time.monotonic() - began)


@pytest.mark.slow
def test_three_weeks_are_there(seeded: Seeded) -> None:
    locations = {location.name: location for location in seeded.client.locations()}
    assert set(locations) == set(FORMS)
    assert sum(location.observations for location in locations.values()) == seeded.posted.measurements
    for location in locations.values():
        assert location.first_time is not None
        assert location.last_time is not None
        assert location.last_time - location.first_time > 20.9 * 86400
        assert 0 <= seeded.now - location.last_time < 5 * INTERVAL_S
        assert location.revision > 0
        assert location.accuracy is not None
    assert locations[BUILDING].min_cells == MIN_CELLS


@pytest.mark.slow
def test_the_planted_anomalies_are_found_and_little_else(seeded: Seeded) -> None:
    story = planted(phases(seeded.now, None)[0], seeded.now)
    door = list(seeded.client.location("office-door").anomalies())
    office = list(seeded.client.location("office-occupied").anomalies())
    during = [[e for e in door if e.observed and e.start < stop and e.stop > start] for start, stop in story.door_open]
    start, stop = story.office_empty
    during.append([event for event in office if not event.observed and event.start < stop and event.stop > start])
    assert [len(found) for found in during] == [1] * len(during), "one event each"
    assert len(list(seeded.client.anomalies())) < 100


@pytest.mark.slow
def test_the_map_looks_like_the_building(seeded: Seeded) -> None:
    state = seeded.client.location(BUILDING).state(time=seeded.now, confidence=0.5, observed=True)
    floor = state.dense("state")[:, :, 0]
    assert (floor == 1).mean() > 0.6
    assert not (floor == 0).any()
    assert 5000 < len(state.cell) < 15000
    assert state.observed is not None
    assert (state.observed >= 0).all()


@pytest.mark.slow
def test_seeding_again_adds_only_what_is_new(seeded: Seeded) -> None:
    before = {location.name: location.observations for location in seeded.client.locations()}
    assert seed(seeded.client, seeded.now, Silent()).measurements == 0
    hour = seed(seeded.client, seeded.now + HOUR_S, Silent())
    after = {location.name: location.observations for location in seeded.client.locations()}
    assert hour.measurements == sum(after.values()) - sum(before.values())
    assert all(0 < after[location] - before[location] <= 12 for location in LOCATIONS)


def running(client: Client, speed: float = 1.0) -> tuple[threading.Event, Callable[[], None]]:
    stop = threading.Event()
    robot = threading.Thread(target=live.run, args=(client, stop, speed))
    robot.start()

    def end() -> None:
        stop.set()
        robot.join(WAIT_S)
        assert not robot.is_alive()

    return stop, end


def test_the_robot_catches_up_a_day_at_most_and_goes_on(server: StartServer) -> None:
    with Client(server().url) as client:
        now = time.time()
        _, end = running(client, speed=600)
        until(lambda: len(client.locations()) == len(FORMS))
        building = client.location(BUILDING)
        until(lambda: (building.get().last_time or 0) > now)
        end()
        known = building.get()
        assert known.first_time is not None
        assert now - live.CATCH_UP_S - INTERVAL_S <= known.first_time <= now - 0.9 * live.CATCH_UP_S
        assert 200 < client.location("main-door").get().observations < 330


def test_the_robot_survives_a_server_that_is_gone_for_a_while(
    server: StartServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "PAUSE_S", 0.1)
    monkeypatch.setattr(live, "CATCH_UP_S", HOUR_S)
    process = server()
    with Client(process.url, retry=RetryPolicy(tries=2, first_s=0.05)) as client:
        _, end = running(client, speed=600)
        location = client.location("main-door")
        until(lambda: "main-door" in [location.name for location in client.locations()])
        until(lambda: location.get().observations > 5)
        process.kill()
        time.sleep(0.5)
        process.restart()
        back = time.time()
        until(lambda: (location.get().last_time or 0) > back)
        end()


def test_somebody_elses_door_is_not_touched(server: StartServer) -> None:
    with Client(server().url) as client:
        client.create_location("office-door", interval_s=60)
        with pytest.raises(NotTheDemoError, match="office-door"):
            seed(client, progress=Silent())
        assert [location.name for location in client.locations()] == ["office-door"]
