"""The figure of the laboratory: what was there, what a visit saw, and what maps expect, from above."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from docs.paper import style
from docs.paper.lab_scores import fitted
from docs.paper.lab_week import BASE, LabMaps, LabWeek
from tidemap.history.history import OCCUPIED, UNOBSERVED
from tidemap.spectral.prediction import predict

HOURS = (17, 42, 83, 125)
"""Since Monday's midnight: those of the paper's Figure 9."""
BAND_M = (0.3, 1.6)
"""Heights that are drawn: above the floor, up to heads."""
TITLES = ("there", "seen on the visit", "expected, registered poses", "expected, stated poses")


def maps(week: LabWeek, split: int, path: Path) -> None:
    """The paper's Figure 9 of the 3D map: each cell from above, as dark as the likeliest in its column."""
    found = week.maps["3D"]
    spectra = [fitted(found.seen[poses], (week.start, split)) for poses in ("registered", "stated")]
    with style.drawing(path, 8.2) as figure:
        rows = figure.subplots(len(HOURS), len(TITLES))
        for row, hour in zip(rows, HOURS, strict=True):
            sample = _visited(found, week.start + int(hour * 3600 / BASE.interval_s))
            truth, seen = (
                history.window(sample, sample + 1).states()[:, 0] for history in (found.truth, found.seen["true"])
            )
            time = float(BASE.time(np.array([sample]))[0])
            expected = [np.clip(predict(spectrum, time), 0, 1) for spectrum in spectra]
            states = [np.where(state == UNOBSERVED, np.nan, state == OCCUPIED) for state in (truth, seen)]
            for axes, values in zip(row, [*states, *expected], strict=True):
                _draw(axes, found, values)
            row[0].set_ylabel(f"t = {hour} h")
        for axes, title in zip(rows[0], TITLES, strict=True):
            axes.set_title(title, fontsize=10)


def _visited(maps: LabMaps, sample: int) -> int:
    """The first sample from one on in which there was a visit."""
    return int(next(each for each in maps.truth.seen() if each >= sample))


def _draw(axes: Axes, maps: LabMaps, values: NDArray[np.floating]) -> None:
    """Values (n_cells,) from above, dark for 1, in a colour of their own where nothing is known."""
    grid = maps.grid
    height = grid.origin[2] + (np.arange(grid.shape3[2]) + 0.5) * grid.resolution_m
    band = values.reshape(grid.shape3)[:, :, (height >= BAND_M[0]) & (height <= BAND_M[1])]
    known = ~np.isnan(band)
    shade = np.max(np.where(known, band, 0.0), axis=2)
    drawn = np.ma.masked_where(~known.any(axis=2), shade)
    axes.set_facecolor("#d6dee6")
    axes.imshow(drawn.T, origin="lower", cmap="gray_r", vmin=0, vmax=1, interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
