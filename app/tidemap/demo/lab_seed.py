"""A week of the laboratory's life, posted as scans through the public client, and the robot that goes on."""

import sys
import time

from tidemap.client import Client
from tidemap.demo.civil import DAY_S
from tidemap.demo.laboratory import FORMS, Laboratory, PostedVisits
from tidemap.demo.live import due
from tidemap.demo.locations import prepare
from tidemap.demo.seed import SEED, chunks, rounds, update
from tidemap.demo.visits import Visitor
from tidemap.demo.world import World
from tidemap.progress import Progress, ShownProgress

HISTORY_S = 7 * DAY_S
HOUR_S = 3600.0
SURVEY_S = HOUR_S
"""So long somebody measures the robot's poses: the first map is made of those visits."""
VISITS_AT_ONCE = 12


def seed(
    client: Client, now: float | None = None, progress: Progress | None = None, history_s: float = HISTORY_S
) -> PostedVisits:
    """Make the laboratory's locations and post visits every five minutes of `history_s` up to `now` (Unix seconds).

    The models are updated after the first hour, every day, and at the end, for scans are registered by them. What the
    server has already is not posted again. Takes some ten minutes. Raises TidemapError, NotTheDemoError.
    """
    now = time.time() if now is None else now
    progress = progress or ShownProgress(sys.stderr)
    laboratory, start = _laboratory(client, now - history_s)
    for stop in _updates(start, now):
        times = rounds(max(start, laboratory.since()), min(stop, now)).tolist()
        if times and _post(laboratory, times, progress):
            update(client, FORMS, progress, "Models")
    return laboratory.posted


class LabPatrol:
    """The visits of the robot to a laboratory that the server knows."""

    def __init__(self, client: Client, now: float) -> None:
        self._laboratory, _ = _laboratory(client, now)

    def go(self, now: float, every_s: float) -> None:
        """Post the visits that were missed, of a day at most, and the latest of every `every_s` seconds."""
        for some in chunks(due(self._laboratory.since(), now, every_s), VISITS_AT_ONCE):
            self._laboratory.post(some)


def _laboratory(client: Client, start: float) -> tuple[Laboratory, float]:
    """The laboratory at a server, and the full hour in which its life began there, or begins."""
    known = prepare(client, FORMS)
    first = min((each.first_time for each in known.values() if each.first_time is not None), default=start)
    first -= first % HOUR_S
    return Laboratory(client, Visitor(World(SEED), first + SURVEY_S), known), first


def _updates(start: float, now: float) -> list[float]:
    """When the models are updated: after the survey, then day by day, and at `now`."""
    days = [start + day * DAY_S for day in range(1, int((now - start) // DAY_S) + 1)]
    return [start + SURVEY_S, *days, now]


def _post(laboratory: Laboratory, times: list[float], progress: Progress) -> bool:
    """Post visits; whether there was one that the server did not have."""
    before = laboratory.posted.visits
    with progress.task("Visits", len(times)) as step:
        for some in chunks(times, VISITS_AT_ONCE):
            laboratory.post(some)
            step(len(some))
    return laboratory.posted.visits > before
