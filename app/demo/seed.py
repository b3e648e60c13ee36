"""Three weeks of the building's life, posted through the public client."""

import sys
import time
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from app.client import Client, TidemapError
from app.demo.civil import DAY_S
from app.demo.locations import BUILDING, FORMS, prepare
from app.demo.posting import Posted, Posting
from app.demo.progress import Progress, Shown
from app.demo.robot import INTERVAL_S, Robot
from app.demo.story import Story, planted
from app.demo.world import World
from app.schemas.locations import Location

SEED = 2014
HISTORY_S = 21 * DAY_S
JUDGED_S = 3 * DAY_S
"""At least so much is posted after the first model is there, so that it is judged by it."""
LEAD_S = 4 * 3600.0
TRAINING_ROUNDS = 48
JUDGED_ROUNDS = 12
"""Rounds of the robot in one post, before and after the first model."""


def seed(client: Client, now: float | None = None, progress: Progress | None = None) -> Posted:
    """Make the demo's locations and post three weeks at five minutes up to `now` (Unix seconds, default: now).

    The last days are posted after the first update, so that the planted anomalies are found. What the server has
    already is not posted again. `progress` is shown on standard error unless given. Takes half a minute.
    Raises TidemapError, NotTheDemoError.
    """
    now = time.time() if now is None else now
    progress = progress or Shown(sys.stderr)
    known = prepare(client)
    story = story_of(known[BUILDING], now)
    robot, posting = Robot(World(SEED, story)), Posting(client, known)
    judged = min(now - JUDGED_S, story.office_empty[0] - LEAD_S)
    if not all(location.revision for location in known.values()):
        _post(posting, robot, rounds(posting.since(), judged, now), TRAINING_ROUNDS, progress, "Posting history")
        _update(client, progress, "Learning the rhythms")
    recent = rounds(posting.since(), now, now)
    _post(posting, robot, recent, JUDGED_ROUNDS, progress, "Posting the last days")
    if len(recent):
        _update(client, progress, "Learning the last days")
    return posting.posted


def story_of(building: Location, now: float) -> Story:
    """The story of the building as the server knows it; new buildings are first seen three weeks before `now`."""
    return planted(now - HISTORY_S if building.first_time is None else building.first_time, now)


def rounds(after: float, until: float, now: float) -> NDArray[np.float64]:
    """Times (n,) of the robot's rounds in (after, until], none longer ago than three weeks before `now`."""
    first = np.floor(max(after, now - HISTORY_S) / INTERVAL_S) + 1
    return np.arange(first, np.floor(until / INTERVAL_S) + 1) * INTERVAL_S


def _post(
    posting: Posting, robot: Robot, times: NDArray[np.float64], at_once: int, progress: Progress, what: str
) -> None:
    if not len(times):
        return
    with progress.task(what, len(times)) as step:
        for some in chunks(times.tolist(), at_once):
            posting.post(look for look in map(robot.look, some) if look is not None)
            step(len(some))


def chunks(times: Sequence[float], size: int) -> Iterator[Sequence[float]]:
    """Consecutive parts of at most `size`."""
    return (times[i : i + size] for i in range(0, len(times), size))


def _update(client: Client, progress: Progress, what: str) -> None:
    with progress.task(what, len(FORMS)) as step:
        for name in FORMS:
            job = client.location(name).update(wait=True)
            if job.state != "done":
                raise TidemapError(0, f"The update of {name} {job.state}", job.error or "no reason was given")
            step(1)
