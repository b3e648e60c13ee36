"""Posters: which robots post to a location, how often, who is silent, and what of theirs was not taken."""

from collections.abc import Sequence
from dataclasses import dataclass

from tidemap.services.context import Context
from tidemap.services.silence import usual
from tidemap.storage.repositories.scans import QUARANTINED
from tidemap.storage.repositories.sources import Refusals, SourceActivity

DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Poster:
    """A robot, '' of those without a name. `activity` of the last day is None where the log has no post of it,
    `quarantined` counts its scans in quarantine, `refused` is None where no post was.

    silent: longer than is usual, by the location's rhythm and the robot's share of its posts.
    """

    name: str
    activity: SourceActivity | None
    silent: bool
    quarantined: int
    refused: Refusals | None

    @property
    def last_received(self) -> float:
        """Unix seconds by this server's clock, 0 of one that the log has nothing of."""
        return self.activity.last_received if self.activity is not None else 0.0


def posters(ctx: Context, name: str) -> Sequence[Poster]:
    """Those of whom the log has posts, scans are in quarantine or posts were refused; the latest first.

    Raises LocationNotFoundError.
    """
    now = ctx.clock()
    with ctx.store.read() as work:
        location = work.locations.get(name)
        log = {each.name: each for each in work.sources.in_log(location, now - DAY_S)}
        quarantined = work.scans.by_source(location.id, QUARANTINED)
        refused = {each.name: each for each in work.sources.refused(location.id)}
        rhythm = usual(work, location)
    whole = sum(each.kept for each in log.values())

    def is_silent(robot: SourceActivity | None) -> bool:
        if robot is None or rhythm is None:
            return False
        return rhythm.is_silent(robot.last_received, now, robot.kept / whole)

    found = [
        Poster(each, log.get(each), is_silent(log.get(each)), quarantined.get(each, 0), refused.get(each))
        for each in {*log, *quarantined, *refused}
    ]
    return sorted(found, key=lambda each: (-each.last_received, each.name))
