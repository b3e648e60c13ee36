"""Nine rooms of a smart home: eight weeks to learn from, then weekly refits and the next week predicted."""

import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from docs.paper import recordings, room_figures
from docs.paper.document import number, table
from docs.paper.weeks import AUTO, Room, every_room
from tidemap.spectral.evaluation import Scores, expected_calibration_error, reliability, score

NEEDS = recordings.ARUBA
FAMILIES = (AUTO, "fft", "day", "weekend", "weekday")
"""`auto` first, then the rivals: the best order of `fft`, the best histogram of every kind."""
HEADINGS = ("auto", "fft", "by day", "by weekend", "by weekday")


def make(images: Path) -> dict[str, str]:
    """The scores per room, the reliability and Figure 7."""
    rooms = every_room()
    best = best_of_each(rooms)
    gap = room_figures.calibration(rooms, best["fft"], images / "reliability.png")
    week = room_figures.anomalies(rooms, images / "figure-7.png")
    return {
        "rooms_log_loss": _table(rooms, best, lambda room, name: _scores(room, name).log_loss),
        "rooms_brier": _table(rooms, best, lambda room, name: _scores(room, name).brier),
        "rooms_calibration": _table(rooms, best, _gap),
        "rooms_rivals": _rivals(best),
        "calibration": gap,
        "room_anomalies": week,
    }


def best_of_each(rooms: list[Room]) -> dict[str, str]:
    """Of every family the candidate with the least mean log loss over the rooms: the rivals look at the answers."""
    loss = {name: np.mean([_scores(room, name).log_loss for room in rooms]) for name in rooms[0].expected}
    return {
        family: min((name for name in loss if name.split()[0] == family), key=lambda name: float(loss[name]))
        for family in FAMILIES
    }


def _scores(room: Room, name: str) -> Scores:
    return score(room.expected[name], room.truth)


def _gap(room: Room, name: str) -> float:
    return expected_calibration_error(reliability(room.expected[name], room.truth))


def _table(rooms: list[Room], best: dict[str, str], measure: Callable[[Room, str], float]) -> str:
    """Per room the score of `auto` and of every family's best, and their ratio."""
    found = np.array([[measure(room, best[family]) for family in FAMILIES] for room in rooms])
    names = [f"{cell + 1}" for cell in range(len(rooms))]
    rows = [_line(name, line) for name, line in zip(names, found, strict=True)]
    rows.append(_line("mean", found.mean(axis=0)))
    return table(("room", *HEADINGS, "auto / best other"), rows)


def _line(name: str, values: NDArray[np.float64]) -> list[str]:
    cells = [number(float(value), 4) for value in values]
    least = int(np.argmin(values))
    cells[least] = f"**{cells[least]}**"
    return [name, *cells, f"{values[0] / values[1:].min():.3f}"]


def _rivals(best: dict[str, str]) -> str:
    kinds = ", ".join(
        f"by {name.split()[0]} in bins of {float(name.split()[1]) / 60:g} minutes, shrinkage {name.split()[2]}"
        for name in (best[family] for family in FAMILIES[2:])
    )
    text = (
        f"The rivals' settings with the least mean log loss over the rooms: `fft` of order {best['fft'].split()[1]}; "
        f"histograms {kinds}."
    )
    return textwrap.fill(text, 120)
