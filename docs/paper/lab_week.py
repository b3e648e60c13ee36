"""Weeks of the simulated laboratory: what maps of the same scans are worth from true, from stated and from registered
poses. The registered ones go through the service, from the points to the history that it stores."""

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from tests.support.contexts import Clock, opened, refit
from tidemap.demo.areas import Area
from tidemap.demo.civil import DAY_S, unix
from tidemap.demo.robot import INTERVAL_S
from tidemap.demo.visits import Scanned, Visit, Visitor
from tidemap.demo.world import World
from tidemap.formats.registry import Body
from tidemap.history import bits
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.ingest.scan import SentScan
from tidemap.schemas.scans import ScanHeader
from tidemap.services.context import Context
from tidemap.services.history import read_history
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.posts import Observed, Post
from tidemap.services.scans import begin_scan
from tidemap.space.grid import GridGeometry
from tidemap.space.pose import Pose
from tidemap.space.scan import Scan
from tidemap.storage.store import prepare_database

START = unix(date(2026, 3, 2).toordinal(), 0.0)
"""A Monday, midnight in London."""
SURVEY_S = 3600.0
"""So long the poses are good, for the first map."""
BASE = TimeBase(0.0, INTERVAL_S)
ORDER = 15
DIMENSIONS = ("2D", "3D")
POSES = ("true", "stated", "registered")
WRONG_M, WRONG_RAD = 0.1, np.radians(1.5)
"""From where on a registration is wrong: a cell, or as much as the far end of a room shows."""


@dataclass(frozen=True, slots=True)
class Error:
    """How far a pose is from the true one (m, rad)."""

    shift: float
    rotation: float

    @classmethod
    def of(cls, found: Pose, true: Pose) -> "Error":
        """That of a pose."""
        rotation = Pose(found.rotation @ true.rotation.T, np.zeros(3)).rotation_vector
        return cls(float(np.linalg.norm(found.translation - true.translation)), float(np.linalg.norm(rotation)))

    @property
    def wrong(self) -> bool:
        """Whether it is more than a cell or 1.5 degrees."""
        return self.shift > WRONG_M or self.rotation > WRONG_RAD


@dataclass(frozen=True, slots=True)
class PostedScan:
    """What became of one scan: its verdict, and how wrong the stated pose is and the one that stands."""

    time: float
    verdict: str
    stated: Error
    standing: Error


@dataclass(frozen=True, slots=True, eq=False)
class LabMaps:
    """One area in 2D or 3D: the exact states at the visits, what was seen by poses, and what became of the scans."""

    grid: GridGeometry
    truth: History
    seen: dict[str, History]
    posted: list[PostedScan]


@dataclass(frozen=True, slots=True, eq=False)
class LabWeek:
    """One area: its maps by dimension, whether a person was seen (one cell), and the samples [start, stop)."""

    area: Area
    maps: dict[str, LabMaps]
    person: History
    start: int
    stop: int


def lab_week(area: Area, seed: int, days: float, every_s: float = INTERVAL_S) -> LabWeek:
    """All visits to an area from START on; 0.1 s each, and an update of each map every day."""
    visitor = Visitor(World(seed), START + SURVEY_S)
    times = np.arange(START, START + days * DAY_S, every_s)
    updates = [START + SURVEY_S, *np.arange(START + DAY_S, START + days * DAY_S, DAY_S).tolist()]
    samples = int(START // INTERVAL_S), int((START + days * DAY_S) // INTERVAL_S)
    person = History.empty(1, samples[0], samples[1] - samples[0])
    with _service() as ctx:
        makers = [_MapMaker(ctx, area, name, samples) for name in DIMENSIONS]
        for part in np.split(times, np.searchsorted(times, updates)):
            for visit in filter(None, (visitor.visit(area, time) for time in part.tolist())):
                _put(person, visit.time, np.zeros(1, np.int64), np.array([visit.person], np.uint8))
                for each in makers:
                    each.add(visit, visitor.world)
            for each in makers:
                each.update()
        return LabWeek(area, {each.name: each.maps() for each in makers}, person, *samples)


@contextmanager
def _service() -> Iterator[Context]:
    """The services on a new database, which is thrown away afterwards."""
    with TemporaryDirectory() as folder:
        url = f"sqlite:///{Path(folder) / 'lab.db'}"
        prepare_database(url)
        with opened(url, Clock(START + 365 * DAY_S)) as ctx:
            yield ctx


class _MapMaker:
    """Makes all maps of an area from the scans of one sensor."""

    def __init__(self, ctx: Context, area: Area, name: str, samples: tuple[int, int]) -> None:
        self.name = name
        self._ctx, self._area, self._samples = ctx, area, samples
        self._spatial = name == "3D"
        self._grid = area.grid if self._spatial else area.floor_grid
        start, stop = samples
        self._truth, *seen = (History.empty(self._grid.n_cells, start, stop - start) for _ in range(3))
        self._seen = dict(zip(POSES[:2], seen, strict=True))
        self._posted: list[PostedScan] = []
        self._sent: list[tuple[float, Scanned, Future[Observed]]] = []
        create_location(
            ctx,
            NewLocation(
                name=name,
                kind="grid3d" if self._spatial else "grid2d",
                grid=self._grid,
                interval_s=INTERVAL_S,
                epoch=0.0,
                estimator="fft",
                order=ORDER,
                min_cells=self._grid.n_cells,  # what a model of the first hours calls abnormal is no event
            ),
        )

    def add(self, visit: Visit, world: World) -> None:
        """Cast its scan from the true and from the stated pose, and post it."""
        scanned = visit.camera if self._spatial else visit.laser
        occupancy = world.occupancy(visit.time)
        truth = self._area.truth(occupancy) if self._spatial else self._area.floor_truth(occupancy)
        _put(self._truth, visit.time, np.arange(len(truth)), truth.astype(np.uint8))
        scan = Scan(scanned.points, scanned.true, max_range_m=scanned.sensor.max_range_m, flat=scanned.sensor.flat)
        for name, pose in (("true", scanned.true), ("stated", scanned.stated)):
            found = scan.at(pose).cast(self._grid)
            _put(self._seen[name], visit.time, found.cell.astype(np.int64), found.state)
        self._sent.append((visit.time, scanned, self._post(visit.time, scanned)))

    def update(self) -> None:
        """Fit the model anew, once all that was posted is stored."""
        self._settle()
        refit(self._ctx, self.name)

    def _post(self, time: float, scanned: Scanned) -> Future[Observed]:
        header = ScanHeader(
            time=time,
            map_from_sensor=[*scanned.stated.values],
            covariance=scanned.covariance.tolist(),
            max_range=scanned.sensor.max_range_m,
        )
        points = scanned.points[:, :2] if scanned.sensor.flat else scanned.points
        return begin_scan(self._ctx, self.name, Post(Body(b"", "")), lambda: SentScan(header, points))

    def _settle(self) -> None:
        self._posted += [_outcome(time, scanned, sent.result()) for time, scanned, sent in self._sent]
        self._sent.clear()

    def maps(self) -> LabMaps:
        """All that was made."""
        self._settle()
        location = find_location(self._ctx, self.name)
        chunks = [read_history(self._ctx, location, chunk, *self._samples) for chunk in range(location.n_chunks)]
        return LabMaps(self._grid, self._truth, {**self._seen, "registered": History.stack(chunks)}, self._posted)


def _outcome(time: float, scanned: Scanned, observed: Observed) -> PostedScan:
    if observed.scan is None:
        raise ValueError(f"the scan of {time} was not stored")
    standing = Pose.of(observed.scan.registration["map_from_sensor"])
    errors = (Error.of(pose, scanned.true) for pose in (scanned.stated, standing))
    return PostedScan(time, observed.scan.verdict, *errors)


def _put(history: History, time: float, cell: NDArray[np.int64], state: NDArray[np.uint8]) -> None:
    """Write what was seen at a time."""
    sample = np.full(len(cell), int(time // INTERVAL_S) - history.start)
    bits.put(history.observed, history.occupied, cell, sample, state)
