"""Map files: the map at one moment as the files that other programs load."""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tidemap.formats import arrow, nav2, octomap, pcd, ply
from tidemap.formats.npy import UNSEEN
from tidemap.formats.table import Column, Labels
from tidemap.history.history import OCCUPIED
from tidemap.media_types import ARROW
from tidemap.space.map_cells import UNCERTAIN, MapCells

BINARY, ZIP = "application/octet-stream", "application/zip"
MAX_SHIFT = 1e-6
"""Cells by which faces may be off OctoMap's without being moved."""


@dataclass(frozen=True, slots=True, eq=False)
class MapContent:
    """What is known of a map, and what the file says of itself where it can: plain values."""

    cells: MapCells
    facts: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class MapFormat:
    """`suffix` of the file's name; `flat` for files of one layer; `spatial` where cells have positions.

    `write` may raise ValueError for a map that the format cannot hold.
    """

    suffix: str
    media_type: str
    write: Callable[[MapContent], bytes]
    flat: bool = False
    spatial: bool = True


def _nav2(content: MapContent) -> bytes:
    states = content.cells.dense_state(UNSEEN)
    states[states == UNCERTAIN] = UNSEEN
    return nav2.write(nav2.FloorPlan(content.cells.grid, states))


def _graded_nav2(content: MapContent) -> bytes:
    return nav2.write_graded(content.cells.grid, content.cells.dense_probability())


def _octomap(content: MapContent) -> bytes:
    cells = content.cells.only(content.cells.state != UNCERTAIN)
    key, comments = _keys(cells)
    return octomap.write_binary(cells.grid.resolution_m, key, cells.state == OCCUPIED, comments)


def _graded_octomap(content: MapContent) -> bytes:
    key, comments = _keys(content.cells)
    return octomap.write(content.cells.grid.resolution_m, key, octomap.log_odds(content.cells.probability), comments)


def _keys(cells: MapCells) -> tuple[Any, tuple[str, ...]]:
    """OctoMap's keys of cells (n, 3), and a comment where its faces, at multiples of the resolution, are not theirs."""
    grid = cells.grid
    low = np.array(grid.origin) / grid.resolution_m
    first = np.rint(low)
    if (first < -octomap.CENTRE).any() or (first + grid.shape3 > octomap.CENTRE).any():
        raise ValueError(f"OctoMap reaches {octomap.CENTRE} cells from zero, and this grid reaches further")
    key = grid.index(cells.cell) + first.astype(np.int64) + octomap.CENTRE
    shift = (first - low) * grid.resolution_m
    if (np.abs(first - low) <= MAX_SHIFT).all():
        return key, ()
    return key, (f"moved by {' '.join(f'{each:.6g}' for each in shift)} m onto OctoMap's faces",)


def _cloud(write: Callable[..., bytes], graded: bool) -> Callable[[MapContent], bytes]:
    def points(content: MapContent) -> bytes:
        cells = content.cells if graded else content.cells.only(content.cells.state == OCCUPIED)
        return write(cells.grid.centre(cells.cell), cells.probability)

    return points


def _npz(content: MapContent) -> bytes:
    cells, packed = content.cells, io.BytesIO()
    state = cells.dense_state(UNSEEN).astype(np.int8).reshape(cells.grid.shape)
    arrays: dict[str, Any] = {key: np.asarray(value) for key, value in _described(content).items()}
    arrays |= {"probability": cells.dense_probability().reshape(cells.grid.shape), "state": state}
    np.savez_compressed(packed, **arrays)
    return packed.getvalue()


def _arrow(content: MapContent) -> bytes:
    cells = content.cells
    columns: dict[str, Column] = {
        "cell": cells.cell.astype(np.uint32),
        "probability": cells.probability,
        "verdict": Labels(cells.state, ("free", "occupied", "uncertain")),
    }
    return bytes(arrow.write(_described(content), columns))


def _described(content: MapContent) -> dict[str, Any]:
    grid = content.cells.grid
    where = {"frame": grid.frame, "origin": list(grid.origin), "resolution_m": grid.resolution_m}
    return {**content.facts, **where, "shape": list(grid.shape)}


FORMATS: Mapping[tuple[str, str], MapFormat] = {
    ("nav2", "trinary"): MapFormat("nav2.zip", ZIP, _nav2, flat=True),
    ("nav2", "scale"): MapFormat("nav2.zip", ZIP, _graded_nav2, flat=True),
    ("octomap", "trinary"): MapFormat("bt", BINARY, _octomap),
    ("octomap", "scale"): MapFormat("ot", BINARY, _graded_octomap),
    ("ply", "trinary"): MapFormat("ply", BINARY, _cloud(ply.write, graded=False)),
    ("ply", "scale"): MapFormat("ply", BINARY, _cloud(ply.write, graded=True)),
    ("pcd", "trinary"): MapFormat("pcd", BINARY, _cloud(pcd.write, graded=False)),
    ("pcd", "scale"): MapFormat("pcd", BINARY, _cloud(pcd.write, graded=True)),
    ("npz", "trinary"): MapFormat("npz", BINARY, _npz, spatial=False),
    ("npz", "scale"): MapFormat("npz", BINARY, _npz, spatial=False),
    ("arrow", "trinary"): MapFormat("arrow", ARROW, _arrow, spatial=False),
    ("arrow", "scale"): MapFormat("arrow", ARROW, _arrow, spatial=False),
}
"""By the name of the format and the mode: states by confidence, or graded probabilities. One line adds a format."""
