"""The figures of the office door: the paper's 1, 4, 5 and 6."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.fft
from matplotlib.axes import Axes
from numpy.typing import NDArray

from docs.paper import recordings, style
from docs.paper.document import table
from docs.paper.forecasts import automatic
from docs.paper.orders import Row
from docs.paper.recordings import DAY_S, SECONDS, WEEK_MINUTES, Runs, runs
from tests.support.office import Office
from tests.unit.spectral.real import MONDAY
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.anomaly import is_anomalous
from tidemap.spectral.model import SpectralModel, update
from tidemap.spectral.prediction import predict_times
from tidemap.spectral.spectrum import components

SHOWN_ORDER, FORECAST_ORDER, ANOMALY_ORDER = 3, 2, 15
CONFIDENCE = 0.95
NIGHT = (18, 6)
THIN = 60
"""One probability a minute is drawn of every second's."""


def model(office: Office, path: Path) -> None:
    """Figure 1: state, probability, thresholded prediction, outliers; the spectrum; the model as text."""
    fitted = update(recordings.history(office.week), "fft", SHOWN_ORDER, SECONDS)
    p = predict_times(fitted.spectrum, office.week.time_s)[0]
    with style.drawing(path, 4.9) as figure:
        left, right = figure.subfigures(1, 2, width_ratios=[1.45, 1], squeeze=False)[0]
        _signals(left.subplots(4, 1, sharex=True), office.week.state, p)
        spectrum, text = right.subplots(2, 1, height_ratios=[1, 1])
        _spectrum(spectrum, office.week.state, fitted)
        text.axis("off")
        text.text(0, 1.0, _text(fitted), family="DejaVu Sans Mono", fontsize=9, va="top", linespacing=1.35)


def _signals(rows: Sequence[Axes], state: NDArray[np.uint8], p: NDArray[np.float32]) -> None:
    time_s = np.arange(state.size)
    _fill(rows[0], runs(state == 1), style.OBSERVED)
    rows[1].plot(time_s[::THIN], p[::THIN], color=style.PREDICTED)
    rows[1].axhline(0.5, color=style.INK, linewidth=0.8, linestyle=":")
    _fill(rows[2], runs(p > 0.5), style.THRESHOLDED)
    _fill(rows[3], runs((p > 0.5) != (state == 1)), style.OUTLIER)
    names = ("s(t) observed", "p(t) probability", "s′(t) = p(t) > 0.5", "O: s′(t) ≠ s(t)")
    ticks = (("free", "occ."), ("0", "1"), ("free", "occ."), ("no", "yes"))
    for axes, name, labels in zip(rows, names, ticks, strict=True):
        axes.set_title(name)
        style.binary_axis(axes, labels)
        style.week_axis(axes, DAY_S)
    rows[3].set_xlabel("local time, one week from Monday")


def _fill(axes: Axes, where: Runs, color: str, top: float = 1.0, bottom: float = 0.0) -> None:
    axes.broken_barh(
        list(zip(where.start, where.stop - where.start, strict=True)),
        (bottom, top - bottom),
        color=color,
        linewidth=0.3,
    )


def _spectrum(axes: Axes, state: NDArray[np.uint8], fitted: SpectralModel) -> None:
    magnitude = np.abs(scipy.fft.rfft(state - state.mean())) / state.size
    per_day = np.arange(57) / 7
    chosen = np.round(components(fitted.spectrum, 0).frequency_hz * DAY_S * 7).astype(int)
    axes.vlines(per_day, 0, magnitude[:57], color=style.OBSERVED, linewidth=1.8)
    axes.vlines(per_day[chosen], 0, magnitude[chosen], color=style.PREDICTED, linewidth=2.6)
    axes.plot(per_day[chosen], magnitude[chosen], "o", color=style.PREDICTED, label="in the model")
    axes.set(title="|P|, the spectrum of s(t)", xlabel="frequency (cycles per day)", ylabel="magnitude", ylim=(0, None))
    axes.legend(loc="upper right")


def _text(fitted: SpectralModel) -> str:
    """The model as the paper prints it: triples of P, limits of O as differences."""
    found, outliers = components(fitted.spectrum, 0), fitted.outliers.of(0)
    rows = zip(found.amplitude / 2, found.phase, 1 / found.frequency_hz / 3600, strict=True)
    lines = [f"P  mean {fitted.spectrum.mean[0]:.3f}", "   abs    arg (rad)  period (h)"]
    lines += [f"   {absolute:.3f}  {phase:+6.2f}     {period:7.1f}" for absolute, phase, period in rows]
    limits = np.diff(outliers.ravel()[:12], prepend=0)
    lines += ["", f"O  {len(outliers)} intervals, limits in s, as Δ:"]
    lines += ["   " + " ".join(f"{each:d}" for each in part) for part in np.split(limits, 2)]
    return "\n".join([*lines[:-1], lines[-1] + " …"])


def forecast(office: Office, path: Path) -> None:
    """Figure 4: two later days as predicted and as they were."""
    spectrum = update(recordings.history(office.week), "fft", FORECAST_ORDER, SECONDS).spectrum
    past = History.from_states(recordings.office_minutes()[np.newaxis, :WEEK_MINUTES])
    minutes = TimeBase(MONDAY, 60.0)
    with style.drawing(path, 4.4) as figure:
        rows = figure.subplots(2, 1)
        for axes, name, day in zip(rows, ("day_1", "day_2"), (office.day_1, office.day_2), strict=True):
            first = int(day.time_s[0])
            _fill(axes, runs(day.state == 1), style.FAINT)
            ahead = np.arange(first // 60, first // 60 + 1440)
            at_s = 60 * np.arange(1440)
            axes.plot(at_s, predict_times(spectrum, ahead * 60.0)[0], color=style.PREDICTED, label="fft, order 2: p(t)")
            axes.plot(at_s, automatic(past, minutes, "UTC", ahead)[0], color=style.OUTLIER, label="auto: p(t)")
            axes.set(title=name, ylabel="probability", ylim=(-0.02, 1.05))
            style.day_axis(axes, 3600)
        rows[0].fill_between([], [], color=style.FAINT, label="s(t): occupied")
        rows[0].legend(loc="upper left")
        rows[1].set_xlabel("local time")


def orders(rows: Sequence[Row], path: Path) -> None:
    """Figure 5: accuracy by order."""
    x = [row.order for row in rows]
    with style.drawing(path, 3.9) as figure:
        axes = figure.subplots()
        for name, label, color, marker in (
            ("reconstruction", "reconstruction, the week", style.INK, "s"),
            ("day_1", "prediction, day_1", style.PREDICTED, "o"),
            ("day_2", "prediction, day_2", style.OUTLIER, "^"),
        ):
            axes.plot(x, [100 * getattr(row, name) for row in rows], marker=marker, color=color, label=label)
        axes.set(xlabel="order of the spectrum (components)", ylabel="accuracy (%)", xlim=(-0.3, 20.3), ylim=(60, 100))
        axes.set_xticks(range(0, 21, 2))
        axes.grid(axis="y", color=style.FAINT)
        axes.legend(loc="lower right")


def anomalies(office: Office, path: Path) -> str:
    """Figure 6: what of the week is anomalous; the counts by rule."""
    week = office.week
    p = predict_times(update(recordings.history(week), "fft", ANOMALY_ORDER, SECONDS).spectrum, week.time_s)[0]
    flagged = is_anomalous(p, week.state, CONFIDENCE)
    with style.drawing(path, 3.4) as figure:
        axes = figure.subplots()
        _fill(axes, runs(week.state == 1), style.FAINT)
        axes.plot(week.time_s[::THIN], p[::THIN], color=style.PREDICTED, label="p(t), order 15")
        axes.fill_between([], [], color=style.FAINT, label="s(t): occupied")
        mark(axes, runs(flagged & (week.state == 1)), runs(flagged & (week.state == 0)))
        axes.set(ylabel="probability", xlabel="local time, one week from Monday")
        style.week_axis(axes, DAY_S)
        style.legend_above(figure, axes)
    return _counts(p, week.state)


def mark(axes: Axes, occupied: Runs, free: Runs) -> None:
    """Anomalies above and below the probabilities, by what was observed."""
    for where, level, color, marker, label in (
        (occupied, 1.1, style.OUTLIER, "v", "occupied, unexpected"),
        (free, -0.1, style.ABSENT, "^", "free, unexpected"),
    ):
        middle = (where.start + where.stop) / 2
        axes.plot(middle, np.full(len(where), level), marker, color=color, markersize=6, label=label)
    axes.set_ylim(-0.16, 1.16)
    axes.set_yticks([0, 0.5, 1])


def _counts(p: NDArray[np.float32], state: NDArray[np.uint8]) -> str:
    rows = []
    for rule, text in (("surprise", "surprise: abs(p − s) > c"), ("paper", "paper, Eq. 6 as printed: s ≠ (p > c)")):
        flagged = is_anomalous(p, state, CONFIDENCE, "surprise" if rule == "surprise" else "paper")
        hour = np.arange(state.size) % DAY_S / 3600
        night = runs(flagged & (state == 1) & ((hour < NIGHT[1]) | (hour >= NIGHT[0])))
        rows.append((text, str(len(runs(flagged))), f"{100 * flagged.mean():.1f}", str(len(night))))
    header = (
        "rule, c = 0.95, order 15",
        "intervals",
        "share of the week (%)",
        f"of them occupied, {NIGHT[0]}:00 to {NIGHT[1]:02d}:00",
    )
    return table(header, rows)
