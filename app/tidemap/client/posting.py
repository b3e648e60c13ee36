"""Posting measurements."""

import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.client import npy
from tidemap.client.encoding import (
    PostedColumns,
    batches,
    indices,
    measurements,
    snapshot,
    snapshots,
    table,
    tristate,
)
from tidemap.client.plans import Plan, Request, Scalar, ask
from tidemap.client.requests import present
from tidemap.client.ros import is_occupancy_grid
from tidemap.client.times import TimeLike, TimesLike, unix
from tidemap.media_types import JSON, MULTIPART, NPY
from tidemap.schemas.observations import Accepted
from tidemap.schemas.ros import map_percent, percentages


@dataclass(frozen=True, slots=True)
class Queued:
    """What was observed is on this machine's disk, in so many batches, and not at the server yet.

    The outbox sends it. What the server says to it (stored, anomalies) nobody waits for.
    """

    batches: int
    measurements: int


Receipt: TypeAlias = Accepted | Queued


@dataclass(frozen=True, slots=True)
class Batch:
    """Some measurements as they are sent to the location at `path`, once or often: the key makes it one.

    A scan, and nothing else, is of several parts.
    """

    path: str
    query: Mapping[str, Scalar]
    content_type: str
    content: bytes
    key: str
    measurements: int

    def request(self) -> Request:
        """The post."""
        headers = {"Content-Type": self.content_type, "Idempotency-Key": self.key}
        kind = "scans" if self.content_type.startswith(MULTIPART) else "observations"
        return Request("POST", f"{self.path}/{kind}", self.query, self.content, headers)


class Postable(Protocol):
    """What is posted, to a server or to an outbox."""

    def batches(self) -> Iterator[Batch]:
        """It in batches, each with its key, made without asking the server anything."""

    def plan(self) -> Plan[Accepted]:
        """Post it."""


@dataclass(frozen=True, slots=True, eq=False)
class GridPost:
    """The state of every cell at a time (Unix seconds) for the location at `path`: `states` of its shape, as int8.

    In layout `ros` they are (ny, nx), in percent.
    """

    path: str
    time: float
    states: NDArray[np.int8]
    source: str | None
    key: str
    layout: str | None = None

    def batches(self) -> Iterator[Batch]:
        """One, for the array must be whole: the server compares its shape."""
        query = present(source=self.source, time=self.time, layout=self.layout)
        yield Batch(self.path, query, NPY, npy.write(self.states), self.key, int(np.count_nonzero(self.states >= 0)))

    def plan(self) -> Plan[Accepted]:
        """Post it."""
        (batch,) = self.batches()
        return (yield from ask(Accepted, batch.request()))


@dataclass(frozen=True, slots=True, eq=False)
class TablePost:
    """Measurements for the location at `path`.

    rows (m, 2 or 3): where the caller gave cells as rows of indices, `columns.cell` counts into them.
    """

    path: str
    columns: PostedColumns
    rows: NDArray[np.int64] | None
    source: str | None
    key: str

    def batches(self) -> Iterator[Batch]:
        """The measurements in batches, each with its key, made without asking the server anything."""
        parts = list(batches(self.columns))
        for i, part in enumerate(parts):
            key = f"{self.key}-{i}" if len(parts) > 1 else self.key
            content_type, content = table(part) if self.rows is None else (JSON, snapshots(part, self.rows))
            yield Batch(self.path, present(source=self.source), content_type, content, key, len(part))

    def plan(self) -> Plan[Accepted]:
        """Post the batches one after the other. It never reads the location, which a robot's key may not."""
        stored = []
        for batch in self.batches():
            response = yield batch.request()
            stored.append(Accepted.model_validate_json(response.content))
        return merged(stored)


def observation(
    path: str, time: TimesLike, state: Any, cell: Any = None, *, source: str | None = None, key: str | None = None
) -> TablePost:
    """Columns of measurements for the location at `path`, with `key` or a new one. Raises ValueError."""
    rows = indices(cell) if np.ndim(cell) == 2 else None
    columns = measurements(time, state, cell if rows is None else np.arange(len(rows)))
    return TablePost(path, columns, rows, source, key or uuid.uuid4().hex)


def whole(path: str, time: TimeLike, states: Any, *, source: str | None = None, key: str | None = None) -> GridPost:
    """The state of every cell for the location at `path`, with `key` or a new one. Raises ValueError."""
    return GridPost(path, unix(time), tristate(states), source, key or uuid.uuid4().hex)


def occupancy(path: str, time: TimeLike, grid: Any, *, source: str | None = None, key: str | None = None) -> GridPost:
    """A map in ROS's layout for the location at `path`: (ny, nx), 0 to 100 percent, -1 unknown. Raises ValueError."""
    percent = map_percent(grid) if is_occupancy_grid(grid) else percentages(np.asarray(grid))
    if percent.ndim != 2:
        raise ValueError(f"in layout 'ros' a map is an array (ny, nx); this has the shape {percent.shape}")
    return GridPost(path, unix(time), percent, source, key or uuid.uuid4().hex, "ros")


def sighting(
    path: str, time: TimeLike, occupied: Any, free: Any, *, source: str | None = None, key: str | None = None
) -> TablePost:
    """One observation of a grid for the location at `path`, with `key` or a new one. Raises ValueError."""
    seen = [np.asarray(cells) for cells in (occupied, free) if len(cells)]
    rows = None
    if any(cells.ndim == 2 for cells in seen):
        if not all(cells.ndim == 2 for cells in seen):
            raise ValueError("give the cells occupied and free both as linear indices or both as rows [i, j, k]")
        rows = np.concatenate([indices(cells) for cells in seen])
        occupied, free = np.split(np.arange(len(rows)), [len(occupied)])
    columns = snapshot(unix(time), np.asarray(occupied), np.asarray(free))
    return TablePost(path, columns, rows, source, key or uuid.uuid4().hex)


def merged(stored: list[Accepted]) -> Accepted:
    """The answers to consecutive batches as one; an anomaly that several report is told as last reported."""
    events = [event for answer in stored for event in answer.anomalies]
    firsts = [answer.first_time for answer in stored if answer.first_time is not None]
    lasts = [answer.last_time for answer in stored if answer.last_time is not None]
    return Accepted(
        accepted=sum(answer.accepted for answer in stored),
        dropped=sum(answer.dropped for answer in stored),
        duplicate=all(answer.duplicate for answer in stored),
        first_time=min(firsts, default=None),
        last_time=max(lasts, default=None),
        anomalies=list({event.id if event.id is not None else -i: event for i, event in enumerate(events)}.values()),
        anomalies_total=sum(answer.anomalies_total for answer in stored),
        revision=stored[-1].revision,
    )
