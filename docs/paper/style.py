"""How the figures look: colours that everybody can tell apart, labels readable at half the size."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

# Okabe and Ito's palette.
OBSERVED = "#9a9a9a"
PREDICTED = "#0072b2"
THRESHOLDED = "#009e73"
OUTLIER = "#d55e00"
OTHER = "#e69f00"
ABSENT = "#a8437f"
INK, FAINT = "#333333", "#d9d9d9"
WIDTH_IN = 9.0
DPI = 160
COLORS = 64
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")

_SETTINGS: dict[Any, Any] = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "font.family": "DejaVu Sans",
    "font.size": 10.5,
    "legend.fontsize": 10,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


@contextmanager
def drawing(path: Path, height_in: float) -> Iterator[Figure]:
    """A figure of the usual width that is written as PNG of few colours, the same bytes for the same drawing."""
    with mpl.rc_context(_SETTINGS):
        figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        drawn = BytesIO()
        figure.savefig(drawn, format="png")
        Image.open(drawn).convert("RGB").quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)


def week_axis(axes: Axes, day_length: float, names: Sequence[str] = DAYS) -> None:
    """Days of local time from a midnight, by their names."""
    days = len(names)
    axes.set_xlim(0, days * day_length)
    axes.set_xticks([day * day_length for day in range(days + 1)], [""] * (days + 1))
    axes.set_xticks([(day + 0.5) * day_length for day in range(days)], names, minor=True)
    axes.tick_params(axis="x", which="minor", length=0)
    for day in range(1, days):
        axes.axvline(day * day_length, color=FAINT, linewidth=0.8, zorder=0)


def day_axis(axes: Axes, hour_length: float, start: float = 0.0) -> None:
    """A day of local time, labelled every third hour."""
    axes.set_xlim(start, start + 24 * hour_length)
    hours = range(0, 25, 3)
    axes.set_xticks([start + hour * hour_length for hour in hours], [f"{hour:02d}:00" for hour in hours])


def legend_above(figure: Figure, axes: Axes) -> None:
    """One row above everything, of what is drawn in `axes`."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, columnspacing=1.2, handlelength=1.4)


def binary_axis(axes: Axes, labels: Sequence[str] = ("free", "occupied")) -> None:
    """The two states on the y axis."""
    axes.set_ylim(-0.12, 1.12)
    axes.set_yticks([0, 1], labels)
