"""Answers about a map as numpy arrays."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.client import arrow
from tidemap.client.map_message import map_message, percent_of
from tidemap.client.ros import OccupancyGrid
from tidemap.media_types import ARROW
from tidemap.schemas.common import parse_time
from tidemap.schemas.locations import Grid
from tidemap.schemas.maps import ExportMode

UNNAMED = "map"
"""A file to which the server gives no name that can be one."""
UNKNOWN = -1
"""In integer arrays: never observed, or not observed then."""

Column: TypeAlias = Literal["probability", "state", "observed", "observed_time", "last_seen"]
Given: TypeAlias = Literal["observations", "model"]


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """time (n_times,) Unix seconds; cell (n_cells,); the others (n_cells, n_times).

    `given` "observations" uses what was read of each cell at or before `as_of`, "model" is the rhythm alone.
    A cell never observed has probability and entropy NaN and state -1. So do those that are `unavailable`: (m, 2)
    ranges [first, stop) of cells whose stored state is damaged, none when all is well at the server.
    """

    time: NDArray[np.float64]
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    entropy: NDArray[np.float32]
    confidence: float
    revision: int
    unavailable: NDArray[np.int64]
    as_of: float
    given: Given


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One cell over time: all (n,). state and observed are -1 where nothing is known."""

    cell: int
    time: NDArray[np.float64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    observed: NDArray[np.int8]
    revision: int


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The map at `time` (Unix seconds), for the cells ever observed: arrays (n,), cell linear in C order.

    `unavailable` (m, 2) are ranges [first, stop) of cells that are missing because their stored state is damaged.
    `given` "observations" uses what was read of each cell at or before `as_of`, "model" is the rhythm alone.
    `observed` (-1: not yet observed then), `observed_time` (NaN) and `last_seen` (NaN), the time of the reading that
    was used, are None unless they were asked for.
    """

    time: float
    as_of: float
    given: Given
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: tuple[int, ...]
    cell: NDArray[np.int64]
    probability: NDArray[np.float32]
    state: NDArray[np.int8]
    verdict: NDArray[np.str_]
    unavailable: NDArray[np.int64]
    observed: NDArray[np.int8] | None = None
    observed_time: NDArray[np.float64] | None = None
    last_seen: NDArray[np.float64] | None = None
    grid: Grid | None = None

    def to_occupancy_grid(
        self, z_min: float = -math.inf, z_max: float = math.inf, mode: ExportMode = "scale"
    ) -> OccupancyGrid:
        """The map as something shaped like nav_msgs/OccupancyGrid, -1 where nothing is known.

        `mode` "scale" is the probability in percent; "trinary" is the verdict, 100 occupied, 0 free, -1 neither, as
        planners want it: Nav2 takes all numbers below 100 for free. Of a location with layers each cell has the highest
        value of those whose centres are from `z_min` to `z_max` (metres). Raises ValueError for a location without a
        grid.
        """
        if self.grid is None:
            raise ValueError("a location of kind 'state' has no grid, so there is no map of it")
        percent = self._dense(percent_of(self.probability, self.verdict, mode))
        return map_message(percent, self.grid, self.time, mode, z_min, z_max)

    def dense(self, column: Column = "probability") -> NDArray[Any]:
        """A column as a grid of `shape`; NaN (integers: -1) where a cell was never observed.

        Raises ValueError for a column that was not asked for.
        """
        values = getattr(self, column)
        if values is None:
            raise ValueError(f"{column} was not asked for; call state(observed=True, last_seen=True)")
        return self._dense(values)

    def _dense(self, values: NDArray[Any]) -> NDArray[Any]:
        unknown = UNKNOWN if values.dtype.kind == "i" else np.nan
        grid = np.full(int(np.prod(self.shape)), unknown, values.dtype)
        grid[self.cell] = values
        return grid.reshape(self.shape)


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """What looking is expected to say, in nats: at most ln 2 of a cell, 0 of a certain one.

    time, entropy and information (n_times,) are sums over the `cells` asked for: what is not known, and what a look
    says of it. cell, cell_entropy and cell_information (n_cells,) are None unless one time was asked for.
    best_time and best_information (n_best,): the best times first, any two at least `apart_s` apart.
    """

    time: NDArray[np.float64]
    entropy: NDArray[np.float64]
    information: NDArray[np.float64]
    cells: int
    cell: NDArray[np.int64] | None
    cell_entropy: NDArray[np.float64] | None
    cell_information: NDArray[np.float64] | None
    best_time: NDArray[np.float64]
    best_information: NDArray[np.float64]
    apart_s: float
    revision: int
    unavailable: NDArray[np.int64]
    as_of: float
    given: Given


@dataclass(frozen=True, slots=True)
class MapFile:
    """A map as a file: the name that the server gives it, its bytes, the time of the map and its revision.

    `revision` is 0 where there is no model. `unavailable` names ranges `first-stop` of cells that are damaged and look
    unknown; it is empty when all is well at the server.
    """

    name: str
    content: bytes
    time: float
    revision: int
    unavailable: str


def prediction(content: bytes) -> Prediction:
    """The answer of `/predict`."""
    said = json.loads(content)
    shape = (len(said["cell"]), len(said["time"]))
    return Prediction(
        np.array(said["time"], np.float64),
        np.array(said["cell"], np.int64),
        _floats(said["probability"]).reshape(shape),
        _states(said["state"]).reshape(shape),
        _floats(said["entropy"]).reshape(shape),
        said["confidence"],
        said["revision"],
        _ranges(said["unavailable"]),
        parse_time(said["as_of"]),
        said["given"],
    )


def series(content: bytes) -> Series:
    """The answer of `/series`."""
    said = json.loads(content)
    return Series(
        said["cell"],
        np.array(said["time"], np.float64),
        _floats(said["probability"]),
        _states(said["state"]),
        _states(said["observed"]),
        said["revision"],
    )


def information(content: bytes) -> Information:
    """The answer of `/information`."""
    said = json.loads(content)
    one = "cell" in said
    return Information(
        time=np.array(said["time"], np.float64),
        entropy=np.array(said["entropy"], np.float64),
        information=np.array(said["information"], np.float64),
        cells=said["cells"],
        cell=np.array(said["cell"], np.int64) if one else None,
        cell_entropy=np.array(said["cell_entropy"], np.float64) if one else None,
        cell_information=np.array(said["cell_information"], np.float64) if one else None,
        best_time=np.array([each["time"] for each in said["best"]], np.float64),
        best_information=np.array([each["information"] for each in said["best"]], np.float64),
        apart_s=said["apart_s"],
        revision=said["revision"],
        unavailable=_ranges(said["unavailable"]),
        as_of=parse_time(said["as_of"]),
        given=said["given"],
    )


def state(content: bytes, media_type: str) -> State:
    """The answer of `/state`, an Arrow IPC stream or JSON."""
    return _state(*(arrow.read(content) if media_type == ARROW else _json_columns(content)))


def map_file(content: bytes, headers: Mapping[str, str]) -> MapFile:
    """The answer of `/export`."""
    time, revision = parse_time(headers["Tidemap-Time"]), int(headers["Tidemap-Revision"])
    return MapFile(
        _file_name(headers.get("Content-Disposition", "")),
        content,
        time,
        revision,
        headers.get("Tidemap-Unavailable", ""),
    )


def _file_name(disposition: str) -> str:
    """The name of a file in a Content-Disposition, without folders; `UNNAMED` where that is no name."""
    name = re.split(r"[/\\:]", disposition.partition("filename=")[2].strip().strip('"'))[-1].strip()
    return name if name.isprintable() and name not in ("", ".", "..") else UNNAMED


def _state(said: Mapping[str, Any], columns: Mapping[str, NDArray[Any]]) -> State:
    return State(
        time=parse_time(said["time"]),
        as_of=parse_time(said["as_of"]),
        given=said["given"],
        confidence=said["confidence"],
        estimator=said["estimator"],
        order=said["order"],
        revision=said["revision"],
        shape=tuple(said["shape"]),
        cell=_numbers(columns["cell"], np.int64),
        probability=_numbers(columns["probability"], np.float32),
        state=_numbers(columns["state"], np.int8),
        verdict=columns["verdict"],
        unavailable=_ranges(said["unavailable"]),
        observed=_numbers(columns["observed"], np.int8) if "observed" in columns else None,
        observed_time=_numbers(columns["observed_time"], np.float64) if "observed_time" in columns else None,
        last_seen=_numbers(columns["last_seen"], np.float64) if "last_seen" in columns else None,
        grid=Grid.model_validate(said["grid"], strict=False) if said.get("grid") is not None else None,
    )


def _json_columns(content: bytes) -> tuple[Any, dict[str, NDArray[Any]]]:
    """The document, and its columns with NaN for null."""
    said = json.loads(content)
    numbers = ("cell", "probability", "state", "observed", "observed_time", "last_seen")
    columns = {name: np.array(said[name], np.float64) for name in numbers if said.get(name) is not None}
    return said, columns | {"verdict": np.array(said["verdict"], np.str_)}


def _ranges(values: Any) -> NDArray[np.int64]:
    return np.array(values, np.int64).reshape(-1, 2)


def _floats(values: Any) -> NDArray[np.float32]:
    """Numbers with null for NaN."""
    return np.array(values, np.float64).astype(np.float32)


def _states(values: Any) -> NDArray[np.int8]:
    """0, 1 and null, which becomes -1."""
    return np.nan_to_num(np.array(values, np.float64), nan=UNKNOWN).astype(np.int8)


def _numbers(values: NDArray[Any], dtype: type[np.number[Any]]) -> NDArray[Any]:
    if values.dtype.kind == "f" and not np.issubdtype(dtype, np.floating):
        values = np.nan_to_num(values, nan=UNKNOWN)
    return values.astype(dtype, copy=False)
