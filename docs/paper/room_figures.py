"""The figures of the nine rooms: the reliability of their probabilities, and the paper's Figure 7."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from docs.paper import style
from docs.paper.document import number, table
from docs.paper.office_figures import mark
from docs.paper.recordings import WEEK_MINUTES, runs
from docs.paper.weeks import AUTO, Room
from tidemap.spectral.anomaly import is_anomalous
from tidemap.spectral.evaluation import Reliability, expected_calibration_error, reliability

SHOWN = (0, 2, 8)
CONFIDENCE = 0.9


def calibration(rooms: list[Room], fft: str, path: Path) -> str:
    """The reliability plot, all rooms pooled, and the table of `auto`."""
    truth = np.concatenate([room.truth for room in rooms])
    found = {name: reliability(np.concatenate([room.expected[name] for room in rooms]), truth) for name in (AUTO, fft)}
    with style.drawing(path, 4.6) as figure:
        axes, counts = figure.subplots(2, 1, height_ratios=[3.2, 1], sharex=True)
        axes.plot([0, 1], [0, 1], color=style.OBSERVED, linewidth=1, linestyle="--", label="perfect")
        for name, label, color, marker in (
            (AUTO, "auto", style.PREDICTED, "o"),
            (fft, fft.replace(" ", " of order "), style.OUTLIER, "^"),
        ):
            _reliability(axes, found[name], label, color, marker)
        axes.set(ylabel="observed share occupied", xlim=(0, 1), ylim=(0, 1.02))
        axes.legend(loc="upper left")
        for offset, name, color in ((-0.02, AUTO, style.PREDICTED), (0.02, fft, style.OUTLIER)):
            counts.bar(np.arange(0.05, 1, 0.1) + offset, found[name].count, 0.036, color=color)
        counts.set(
            yscale="log",
            ylim=(1e3, 1e6),
            ylabel="minutes",
            xlabel="predicted probability of being occupied, nine rooms, weeks 9 to 16",
        )
        counts.set_xticks(np.arange(0, 1.01, 0.1))
    return _table(found[AUTO])


def _reliability(axes: Axes, found: Reliability, label: str, color: str, marker: str) -> None:
    error = expected_calibration_error(found)
    text = f"{label}: expected calibration error {number(error)}"
    axes.plot(found.probability_mean, found.observed_rate, marker=marker, color=color, label=text)


def _table(found: Reliability) -> str:
    edges = np.arange(10) / 10
    rows = [
        (f"{edge:.1f} to {edge + 0.1:.1f}", number(float(mean)), number(float(rate)), f"{count:,}")
        for edge, mean, rate, count in zip(edges, found.probability_mean, found.observed_rate, found.count, strict=True)
    ]
    gap = f"\n\nExpected calibration error of `auto`, all rooms pooled: {number(expected_calibration_error(found))}."
    return table(("p(t)", "mean of p(t)", "observed share", "minutes"), rows) + gap


def anomalies(rooms: list[Room], path: Path) -> str:
    """Figure 7: the ninth week of three rooms as predicted from the eight before, and what was anomalous."""
    counts = []
    with style.drawing(path, 6.2) as figure:
        every = figure.subplots(len(SHOWN), 1, sharex=True)
        for axes, cell in zip(every, SHOWN, strict=True):
            counts.append(_week(axes, rooms[cell], cell))
        style.legend_above(figure, every[0])
        every[-1].set_xlabel("local time, ninth week of the recording")
    return table(
        ("room", "occupied, unexpected (intervals)", "free, unexpected (intervals)", "share of the week (%)"), counts
    )


def _week(axes: Axes, room: Room, cell: int) -> list[str]:
    state, p = room.truth[:WEEK_MINUTES], room.expected[AUTO][:WEEK_MINUTES]
    flagged = is_anomalous(p, state, CONFIDENCE)
    occupied, free = runs(flagged & (state == 1)), runs(flagged & (state == 0))
    where = runs(state == 1)
    axes.broken_barh(list(zip(where.start, where.stop - where.start, strict=True)), (0, 1), color=style.FAINT)
    axes.plot(np.arange(state.size), p, color=style.PREDICTED, label="p(t), auto")
    axes.fill_between([], [], color=style.FAINT, label="s(t): occupied")
    mark(axes, occupied, free)
    axes.set(title=f"room {cell + 1}", ylabel="probability")
    style.week_axis(axes, 1440, [f"day {day}" for day in range(57, 64)])
    return [str(cell + 1), str(len(occupied)), str(len(free)), f"{100 * flagged.mean():.1f}"]
