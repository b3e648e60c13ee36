"""Robots: where the sensors of a map have been, by the poses of their scans."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.services.context import Context
from tidemap.space.pose import Pose

MAX_POSES: Final = 1000
"""Poses that are read at a time, the newest."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorTrack:
    """Where the sensor of one source has been: time (n,) Unix seconds, ascending; map_from_sensor, its poses then."""

    source: str
    time: NDArray[np.float64]
    map_from_sensor: list[Pose]


def sensor_tracks(ctx: Context, location_id: int, start: float, stop: float) -> list[SensorTrack]:
    """Of every source that posted scans of [start, stop] whose poses stand, by name; '' of robots without one."""
    with ctx.store.read() as work:
        found = work.scans.placed_within(location_id, start, stop, MAX_POSES)
    by_source: defaultdict[str, list[tuple[float, Pose]]] = defaultdict(list)
    for record in reversed(found):
        by_source[record.source or ""].append((record.time, Pose.of(record.registration["map_from_sensor"])))
    return [
        SensorTrack(source, np.array([time for time, _ in track]), [pose for _, pose in track])
        for source, track in sorted(by_source.items())
    ]


def has_scans(ctx: Context, location_id: int) -> bool:
    """Whether any scan of a map is listed."""
    with ctx.store.read() as work:
        return bool(work.scans.list(location_id, limit=1))
