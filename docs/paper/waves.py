"""The waves of `calendar`, from the code itself."""

from pathlib import Path

import numpy as np

from docs.paper.document import table
from tidemap.spectral.calendar import waves
from tidemap.spectral.recipe import Week

NEEDS: tuple[str, ...] = ()
KINDS = ("of every day", "of weekends only", "of single weekdays")
HEADER = ("waves", "number", "cycles a week", *(f"σ, week: {week}" for week in waves.DIFFERENCE))


def make(_images: Path) -> dict[str, str]:
    """Their number, frequencies and how much each kind may differ under the priors."""
    rows = []
    for kind, name in enumerate(KINDS):
        cycles = waves.CYCLES_A_WEEK[kind == waves.KIND]
        rows.append([name, str(cycles.size), _cycles(cycles), *(_sigma(kind, week) for week in waves.DIFFERENCE)])
    rows.append(
        [
            "of a period, where one is found",
            str(waves.OVERTONES),
            _overtones(),
            *[f"{waves.SCALE:g}"] * len(waves.DIFFERENCE),
        ]
    )
    return {"waves": table(HEADER, rows)}


def _cycles(cycles: np.ndarray) -> str:
    every = np.sort(cycles)
    steps = np.unique(np.diff(every))
    return (
        ", ".join(f"{each:g}" for each in every[:4])
        + f", … {every[-1]:g}"
        + (" (not 7, 14, …)" if steps.size > 1 else "")
    )


def _overtones() -> str:
    return ", ".join(str(each) for each in range(1, waves.OVERTONES + 1)) + " a period"


def _sigma(kind: int, week: Week) -> str:
    share = (1.0, *waves.DIFFERENCE[week])[kind]
    return f"{waves.SCALE * share:g}"
