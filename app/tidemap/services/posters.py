"""Posters: which robots post to a location, how often, and what of theirs is in quarantine."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from tidemap.services.context import Context
from tidemap.storage.repositories.scans import QUARANTINED

DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Poster:
    """A robot, '' of those without a name. `posts` and `measurements` are of the last day, `quarantined` counts its
    scans in quarantine. last_received: by this server's clock, last_measured: by the robot's; None without either.
    """

    name: str
    posts: int = 0
    measurements: int = 0
    last_received: float | None = None
    last_measured: float | None = None
    quarantined: int = 0


def posters(ctx: Context, name: str) -> Sequence[Poster]:
    """Those whose posts the log still has, the latest first. Raises LocationNotFoundError."""
    with ctx.store.read() as work:
        location = work.locations.get(name)
        log = work.sources.in_log(location, ctx.clock() - DAY_S)
        quarantined = work.scans.by_source(location.id, QUARANTINED)
    found = [Poster(**asdict(each), quarantined=quarantined.pop(each.name, 0)) for each in log]
    found += [Poster(source, quarantined=number) for source, number in quarantined.items()]
    return sorted(found, key=lambda each: (-(each.last_received or 0.0), each.name))
