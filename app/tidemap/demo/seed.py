"""Three weeks of the building's life, posted through the public client."""

import sys
import time
from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tidemap.client import Client, TidemapError
from tidemap.demo.civil import DAY_S
from tidemap.demo.locations import BUILDING, FORMS, begin_events, prepare
from tidemap.demo.posting import Posted, Posting
from tidemap.demo.robot import INTERVAL_S, Robot
from tidemap.demo.story import planted
from tidemap.demo.world import World
from tidemap.progress import Progress, ShownProgress

SEED = 2014
HISTORY_S = 21 * DAY_S
TRAINED_S = 14 * DAY_S
"""At least so much is posted before the first update: two whole weeks, so that it sees the week."""
JUDGED_S = 3 * DAY_S
"""At least so much is posted after the first update, so that it is judged by the first model."""
LEAD_S = 3600.0
ROUNDS_AT_ONCE = 48
"""Rounds of the robot in one post: four hours."""


def seed(client: Client, now: float | None = None, progress: Progress | None = None) -> Posted:
    """Make the demo's locations and post three weeks at five minutes up to `now` (Unix seconds, default: now).

    The last days are posted after the first update, so that the planted anomalies are found. What the server
    has already is not posted again. `progress` is shown on standard error unless given. Takes half a minute.
    Raises TidemapError, NotTheDemoError.
    """
    now = time.time() if now is None else now
    progress = progress or ShownProgress(sys.stderr)
    known = prepare(client)
    start, judged = phases(now, known[BUILDING].first_time)
    robot, posting = Robot(World(SEED, planted(start, now))), Posting(client, known)
    history = rounds(max(start, posting.since()), judged)
    if len(history):
        _post_history(posting, robot, history, progress)
        update(client, FORMS, progress, "First models")
    begin_events(client)
    recent = rounds(max(judged, posting.since()), now)
    if len(recent):
        _post_recent(posting, robot, recent, progress)
        update(client, FORMS, progress, "Models")
    return posting.posted


def phases(now: float, first_time: float | None) -> tuple[float, float]:
    """When the building's life begins, if it has not yet, and up to when it is posted before the first update."""
    story = planted(now, now)
    judged = min(now - JUDGED_S, story.office_empty[0] - LEAD_S)
    return min(now - HISTORY_S, judged - TRAINED_S) if first_time is None else first_time, judged


def rounds(after: float, until: float) -> NDArray[np.float64]:
    """Times (n,) of the robot's rounds in (after, until].

    >>> rounds(300.0, 900.0).tolist(), rounds(299.0, 300.0).tolist()
    ([600.0, 900.0], [300.0])
    """
    return np.arange(after // INTERVAL_S + 1, until // INTERVAL_S + 1) * INTERVAL_S


def _post_history(posting: Posting, robot: Robot, times: NDArray[np.float64], progress: Progress) -> None:
    """The locations come last and at once, so that no model of a part of their history judges the rest."""
    seen: list[tuple[float, dict[str, bool]]] = []
    with progress.task("History", len(times)) as step:
        for some in chunks(times.tolist(), ROUNDS_AT_ONCE):
            observations = robot.observations(some)
            posting.post_building(observations)
            seen += [(observation.time, observation.locations) for observation in observations]
            step(len(some))
        posting.post_locations(*zip(*seen, strict=True))


def _post_recent(posting: Posting, robot: Robot, times: NDArray[np.float64], progress: Progress) -> None:
    with progress.task("Last days", len(times)) as step:
        for some in chunks(times.tolist(), ROUNDS_AT_ONCE):
            posting.post(robot.observations(some))
            step(len(some))


def chunks(times: Sequence[float], size: int) -> Iterator[Sequence[float]]:
    """Consecutive parts of at most `size`."""
    return (times[i : i + size] for i in range(0, len(times), size))


def update(client: Client, names: Collection[str], progress: Progress, what: str) -> None:
    """Fit the models of some locations anew. Raises TidemapError where an update fails."""
    with progress.task(what, len(names)) as step:
        for name in names:
            job = client.location(name).update(wait=True)
            if job.state != "done":
                raise TidemapError(0, f"The update of {name} {job.state}", job.error or "no reason was given")
            step(1)
