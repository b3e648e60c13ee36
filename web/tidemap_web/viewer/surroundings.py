"""Surroundings: the doors and rooms in the frame of a grid, as markers, and where its sensors have been."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tidemap.history.history import UNOBSERVED
from tidemap.services.building import PosedState
from tidemap.services.locations import LocationSummary
from tidemap.services.robots import SensorTrack
from tidemap.services.spectra import Fitted
from tidemap.spectral.prediction import VERDICTS, verdict
from tidemap_web.viewer import colors
from tidemap_web.viewer.asked import fresh_s_of
from tidemap_web.viewer.news import Fresh
from tidemap_web.viewer.painting import EXPECTED_FREE, MISSING, OCCUPIED, STALE, UNEXPECTED, mark_of
from tidemap_web.viewer.source import Source

TRACK_S: Final = 3600.0
"""How far back the track of a sensor is shown."""
KEPT_S: Final = 1800.0
"""How far before and after what is shown tracks are kept, so that a step asks nothing."""
VERDICT_COLORS: Final = {
    "free": colors.FREE,
    "occupied": colors.OCCUPIED,
    "uncertain": colors.UNCERTAIN,
    None: colors.UNKNOWN,
}
MARK_COLORS: Final = {
    OCCUPIED: colors.OCCUPIED,
    EXPECTED_FREE: colors.FREE,
    UNEXPECTED: colors.UNEXPECTED,
    MISSING: colors.MISSING,
    STALE: colors.STALE,
}


@dataclass(frozen=True, slots=True)
class Marker:
    """A door or a room at (x, y, z) in metres. colors: in the left grid and in the right one.

    probability and verdict: by its model, None without one; observed: as last seen, None where it never was.
    """

    name: str
    position: tuple[float, float, float]
    colors: tuple[colors.Rgb, colors.Rgb]
    probability: float | None
    verdict: str | None
    observed: int | None
    observed_time: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Where a sensor has been: points (n, 3) in metres, ascending in time up to `last` (Unix seconds), and how it is
    turned there, a unit quaternion (4,), w first."""

    source: str
    last: float
    points: NDArray[np.float64]
    wxyz: NDArray[np.float64]

    def same_as(self, other: "Track") -> bool:
        """Whether another one is drawn the same."""
        mine, others = (self.source, self.last, len(self.points)), (other.source, other.last, len(other.points))
        return mine == others and np.array_equal(self.points[0], other.points[0])


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What stands and moves around the cells of a grid at a time."""

    markers: tuple[Marker, ...] = ()
    tracks: tuple[Track, ...] = ()

    @property
    def positions(self) -> NDArray[np.float64]:
        """(n, 3) of the markers, in metres."""
        return np.array([marker.position for marker in self.markers], np.float64).reshape(-1, 3)


NOBODY: Final = Around()


class Surroundings:
    """Keeps what is asked of the source for many moments. Used by its session's worker; `names` by any thread."""

    def __init__(self, source: Source) -> None:
        self.names: frozenset[str] = frozenset()
        self._source = source
        self._of: tuple[int, str] | None = None
        self._models: list[Fitted] = []
        self._scanned = False
        self._tracks: list[SensorTrack] = []
        self._span = (np.inf, -np.inf)

    def refresh(self, location: LocationSummary, fresh: Fresh | None) -> None:
        """Ask anew for what news concern; None: nothing is known yet."""
        of = (location.id, "" if location.grid is None else location.grid.frame)
        anew = fresh is None or of != self._of
        self._of, news = of, fresh or {}
        if anew or self.names & news.keys() or any("location" in kinds for kinds in news.values()):
            self._models = self._source.posed(of[1])
            self.names = frozenset(model.location.name for model in self._models)
        if anew or location.name in news:
            self._scanned, self._span = self._source.has_scans(location), (np.inf, -np.inf)

    def at(self, location: LocationSummary, time: float, confidence: float | None, overlaid: bool) -> Around:
        """At a time. confidence: None for each location's own; overlaid: one grid shows what was seen otherwise too."""
        if not self._models and not self._scanned:
            return NOBODY
        states = self._source.posed_at(self._models, time) if self._models else []
        markers = tuple(_marker(state, time, confidence, overlaid) for state in states)
        return Around(markers, tuple(self._tracks_at(location, time)) if self._scanned else ())

    def _tracks_at(self, location: LocationSummary, time: float) -> list[Track]:
        start = time - TRACK_S
        if not (self._span[0] <= start and time <= self._span[1]):
            self._span = (start - KEPT_S, time + KEPT_S)
            self._tracks = self._source.tracks(location, *self._span)
        return [track for each in self._tracks if (track := _track(each, start, time)) is not None]


def _track(track: SensorTrack, start: float, stop: float) -> Track | None:
    """The part within [start, stop], None where there is none."""
    first, last = np.searchsorted(track.time, [start, np.nextafter(stop, np.inf)]).tolist()
    if first == last:
        return None
    poses = track.map_from_sensor[first:last]
    qx, qy, qz, qw = poses[-1].values[3:]
    points = np.array([pose.translation for pose in poses])
    return Track(track.source, float(track.time[last - 1]), points, np.array([qw, qx, qy, qz]))


def _marker(state: PosedState, time: float, confidence: float | None, overlaid: bool) -> Marker:
    location, p = state.location, state.probability
    limit = location.confidence if confidence is None else confidence
    fresh = state.observed_time is not None and state.observed_time >= time - fresh_s_of(location)
    mark = mark_of(state.observed, fresh, np.float32(p), np.float32(limit))
    said = None if np.isnan(p) else VERDICTS[int(verdict(np.float32(p), limit))]
    seen = MARK_COLORS.get(mark, colors.UNKNOWN)
    predicted = seen if overlaid and mark in (UNEXPECTED, MISSING) else VERDICT_COLORS[said]
    observed = None if state.observed == UNOBSERVED else state.observed
    position = (0.0, 0.0, 0.0) if location.pose is None else location.pose.position
    shown = None if said is None else p
    return Marker(location.name, position, (predicted, seen), shown, said, observed, state.observed_time)
