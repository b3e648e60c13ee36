"""The laboratory of `tidemap demo --sensors` against a real server process."""

import time
from datetime import datetime
from zoneinfo import ZoneInfo

from tests.support.server import StartServer
from tidemap.client import Client
from tidemap.demo.areas import AREAS
from tidemap.demo.lab_seed import SURVEY_S, LabPatrol, seed
from tidemap.demo.laboratory import FORMS, camera_name, laser_name, person_name
from tidemap.demo.robot import INTERVAL_S
from tidemap.demo.seed import SEED
from tidemap.demo.world import World
from tidemap.progress import Silent

LATER_S = 3 * INTERVAL_S


def last_night() -> float:
    """Four in the morning of a day that is over: nothing moves."""
    yesterday = datetime.fromtimestamp(time.time() - 86_400, ZoneInfo("Europe/London"))
    return yesterday.replace(hour=4, minute=0, second=0, microsecond=0).timestamp()


def test_scans_are_registered_once_the_survey_has_made_a_map(server: StartServer) -> None:
    now = last_night() + LATER_S
    # The updater of a slow machine would make the map before the survey has ended.
    with Client(server(env={"TIDEMAP_UPDATER": "false"}).url) as client:
        posted = seed(client, now, Silent(), SURVEY_S + LATER_S)
        assert set(posted.verdicts) == {"raw_pose", "accepted"}
        assert 2 * len(AREAS) * 8 < posted.verdicts["raw_pose"] <= 2 * len(AREAS) * SURVEY_S / INTERVAL_S
        assert 2 * len(AREAS) <= posted.verdicts["accepted"] <= 2 * len(AREAS) * 3
        for area in AREAS:
            occupancy = World(SEED).occupancy(now)
            for name, truth in (
                (camera_name(area), area.truth(occupancy)),
                (laser_name(area), area.floor_truth(occupancy)),
            ):
                map_now = client.location(name).state(time=now, confidence=0.5)
                assert (truth[map_now.cell] == (map_now.state == 1)).mean() > 0.92
            assert client.location(person_name(area)).get().observations > 10

        before = {name: client.location(name).get().observations for name in FORMS}
        assert seed(client, now, Silent()).visits == 0, "all of it is there"
        LabPatrol(client, now).go(now + 2 * INTERVAL_S, INTERVAL_S)
        assert all(client.location(name).get().observations > before[name] for name in FORMS)
