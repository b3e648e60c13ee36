"""Makes docs/images/carmen.png of both CARMEN logs in ../shared/data: `python -m docs.draw_carmen_maps`.

Each cell is as dark as the share of its snapshots that saw it occupied; what was never seen is grey-blue.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.support.paths import ROOT
from tidemap.importing.options import ImportOptions
from tidemap.importing.records import Missing
from tidemap.importing.run import survey_files
from tidemap.importing.snapshots import snapshot_of
from tidemap.progress import Silent
from tidemap.space.grid import GridGeometry

DATA = ROOT.parent / "shared" / "data" / "carmen2d"
LOGS = ("intel-corrected.log.gz", "freiburg-101-corrected.log.gz")
IMAGE = ROOT / "docs" / "images" / "carmen.png"
RESOLUTION_M, MAX_RANGE_M = 0.1, 20.0
UNSEEN = (214, 222, 230)
GAP = 12
"""Pixels between the maps."""


def main() -> int:
    """Draw both, beside one another; the exit status."""
    if absent := [name for name in LOGS if not (DATA / name).is_file()]:
        sys.stderr.write(f"{DATA} lacks {', '.join(absent)}\n")
        return 1
    maps = [_drawn(DATA / name) for name in LOGS]
    height = max(len(each) for each in maps)
    parts = [part for each in maps for part in (_padded(each, height), np.full((height, GAP, 3), 255, np.uint8))]
    Image.fromarray(np.concatenate(parts[:-1], axis=1)).quantize(64).save(IMAGE, optimize=True)
    sys.stdout.write(f"wrote {IMAGE.relative_to(ROOT)}\n")
    return 0


def _drawn(path: Path) -> NDArray[np.uint8]:
    """A map (height, width, 3), the highest y on top."""
    options = ImportOptions(resolution_m=RESOLUTION_M, max_range_m=MAX_RANGE_M)
    report = survey_files([path], options, Silent())
    if report.proposal is None:
        raise ValueError(f"{path}: {report.problems}")
    form = report.proposal["grid"]
    grid = GridGeometry("map", tuple(form["origin"]), RESOLUTION_M, tuple(form["shape"]))
    occupied, seen = np.zeros(grid.n_cells), np.zeros(grid.n_cells)
    for source in report.sources:
        for record in source.records():
            if not isinstance(record, Missing):
                snapshot = snapshot_of(record, grid, 1)
                seen[snapshot.cell] += 1
                occupied[snapshot.cell] += snapshot.state
    return _shades(occupied, seen).reshape(*grid.shape, 3).transpose(1, 0, 2)[::-1]


def _shades(occupied: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n_cells, 3)."""
    shade = 255 * (1 - occupied / np.maximum(seen, 1))
    return np.where(seen[:, np.newaxis] > 0, shade[:, np.newaxis], np.array(UNSEEN)).astype(np.uint8)


def _padded(picture: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    above = height - len(picture)
    return np.pad(picture, ((above // 2, above - above // 2), (0, 0), (0, 0)), constant_values=255)


if __name__ == "__main__":
    sys.exit(main())
