"""What the monitoring asks of the database, at one moment."""

from collections.abc import Sequence
from dataclasses import dataclass

from tidemap.services.context import Context
from tidemap.storage.repositories.locations import LatestTimes, LocationFilter

MAX_NAMED_LOCATIONS = 100
"""Locations that are named one by one, the oldest ones: each makes series of its own."""


@dataclass(frozen=True, slots=True)
class Monitored:
    """waiting: measurements that are not compacted yet; latest: of the oldest locations."""

    locations: int
    latest: Sequence[LatestTimes]
    waiting: int
    database_bytes: int


def monitored(ctx: Context) -> Monitored:
    """What is stored now. Raises StorageUnavailableError."""
    with ctx.store.read() as work:
        locations, latest = work.locations.count(LocationFilter()), work.locations.latest(MAX_NAMED_LOCATIONS)
        waiting = sum(work.observations.waiting().values())
    return Monitored(locations, latest, waiting, ctx.store.size_bytes())
