"""Two rooms over the end of summer time: `calendar` on the clock of the building and on UTC."""

from pathlib import Path

import numpy as np

from docs.paper import recordings
from docs.paper.document import number, table
from docs.paper.forecasts import automatic, with_recipe
from tidemap.spectral.evaluation import score
from tidemap.spectral.recipe import Recipe

NEEDS = recordings.BRAINS4BUILDINGS
CHANGE, STOP = 20 * 96, 24 * 96
"""Quarters of an hour from Monday, 10 October 2022, to the Sunday the clocks go back, and the four days from then."""
HEADER = ("estimator", "clock", "log loss", "Brier", "error")


def make(_images: Path) -> dict[str, str]:
    """Learned from the twenty days before the change, scored on the four days from it."""
    signal = recordings.brains4buildings()
    past, ahead = signal.history.window(0, CHANGE), np.arange(CHANGE, STOP)
    truth = signal.history.states()[:, ahead]
    rows = []
    for zone in (signal.time_zone, "UTC"):
        for name, p in (
            ("calendar, usual priors", with_recipe(past, signal.base, Recipe("calendar", time_zone=zone), ahead)),
            ("auto", automatic(past, signal.base, zone, ahead)),
        ):
            found = score(p, truth)
            rows.append([name, zone, *(number(each, 4) for each in (found.log_loss, found.brier, found.error))])
    return {"clocks": table(HEADER, sorted(rows, key=lambda row: row[0], reverse=True))}
