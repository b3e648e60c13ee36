"""Whole maps: those of map_server and of OctoMap, as one observation."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml

from tidemap.errors import UnreadableBodyError
from tidemap.formats import nav2, octomap
from tidemap.importing.files import content_of, suffix_of
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Record, WholeMap
from tidemap.space.grid import GridGeometry

MAP_SUFFIXES, TREE_SUFFIXES = {".yaml", ".yml", ".zip"}, {".bt", ".ot"}
MAX_MAP_CELLS = 256 * 2**20
"""Of the box around a tree."""


@dataclass(frozen=True)
class FloorMap:
    """A map of map_server: its YAML, with the picture beside it, or both in a zip."""

    path: Path
    options: ImportOptions
    what: str = "map of map_server"
    kind: Literal["grid"] = "grid"

    def records(self) -> Iterator[Record]:
        """The map. Raises UnreadableBodyError."""
        content, frame = content_of(self.path), self.options.fixed_frame
        if suffix_of(self.path) == ".zip":
            plan = nav2.read(content, frame)
        else:
            plan = nav2.read_pair(content, content_of(self._picture(content)), frame)
        yield WholeMap(time_of(self.path, self.options), plan.grid, plan.state)

    def _picture(self, described: bytes) -> Path:
        """The picture that the YAML names, beside it, also packed with gzip."""
        try:
            named = yaml.safe_load(described)["image"]
        except Exception:  # whatever is wrong is said when the pair is read
            raise UnreadableBodyError("This map cannot be read: its YAML names no image.") from None
        found = self.path.parent / Path(str(named)[:1000]).name
        for each in (found, found.with_name(f"{found.name}.gz")):
            if each.is_file():
                return each
        raise UnreadableBodyError(f"This map cannot be read: there is no {found}, which its YAML names as image.")


@dataclass(frozen=True)
class Tree:
    """A tree of OctoMap."""

    path: Path
    options: ImportOptions
    what: str = "OctoMap"
    kind: Literal["grid"] = "grid"

    def records(self) -> Iterator[Record]:
        """The map. Raises UnreadableBodyError."""
        tree = octomap.read(content_of(self.path))
        low, stop = tree.bounds()
        if np.prod((stop - low).astype(float)) > MAX_MAP_CELLS:
            raise UnreadableBodyError(
                f"The box around its tree has {' x '.join(map(str, stop - low))} cells; at most {MAX_MAP_CELLS} are "
                "read. Cut out a part of it."
            )
        grid: GridGeometry = tree.grid(self.options.fixed_frame, low, stop)
        yield WholeMap(time_of(self.path, self.options), grid, tree.states(low, stop))


def time_of(path: Path, options: ImportOptions) -> float:
    """When a map without a time was so: as the options say, or when its file was changed."""
    return path.stat().st_mtime if options.time is None else options.time
