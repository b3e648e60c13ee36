"""The paper's laboratory, simulated: Table I, what registration is worth, and maps beside what was there."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from docs.paper import lab_figures, lab_person
from docs.paper.document import number, table
from docs.paper.lab_scores import against_observed, against_truth, known_cells
from docs.paper.lab_week import DIMENSIONS, START, SURVEY_S, Error, LabMaps, LabWeek, lab_week
from tidemap.demo.areas import AREAS
from tidemap.demo.civil import DAY_S
from tidemap.demo.robot import INTERVAL_S

NEEDS = ()
SEED = 20130902
"""Of the week that is shown; no limit was set with it. The paper's week begins on this day."""
DAYS, WEEK_DAYS = 9, 7
PAPER = {
    "lab-west": {"1D": 0.95, "2D": 0.99, "3D": 0.99},
    "lab-east": {"1D": 0.98, "2D": 0.97, "3D": 1.0},
    "corridor": {"1D": 0.94, "2D": 0.98, "3D": 0.99},
}
"""Its Table I, locations 1 to 3."""


def make(images: Path) -> dict[str, str]:
    """Simulate, post, fit and score everything; some minutes a location."""
    with ProcessPoolExecutor(len(AREAS)) as pool:
        weeks = list(pool.map(partial(lab_week, seed=SEED, days=DAYS), AREAS))
    lab_figures.maps(weeks[0], split(weeks[0]), images / "figure-9.png")
    return {
        "laboratory": table_1(weeks),
        "lab_person": lab_person.table_of_people(SEED, WEEK_DAYS),
        "lab_poses": poses(weeks),
        "lab_registration": registration(weeks),
    }


def split(week: LabWeek) -> int:
    """The first sample that is not learned from."""
    return week.start + int(WEEK_DAYS * DAY_S / INTERVAL_S)


def table_1(weeks: list[LabWeek]) -> str:
    """Reconstruction and prediction by area and dimension."""
    header = ("location", "data", "cells", "the paper", "reconstruction", "prediction, next two days")
    return table(header, (row for week in weeks for row in _rows(week)))


def _rows(week: LabWeek) -> list[list[str]]:
    histories = {"1D": week.person} | {name: maps.seen["registered"] for name, maps in week.maps.items()}
    rows = []
    for name, history in histories.items():
        found = against_observed(history, split(week))
        n_cells = int(history.ever_observed().sum())
        paper = number(PAPER[week.area.name][name], 2)
        rows.append([week.area.name, name, f"{n_cells:,}", paper, number(found.week), number(found.later)])
    return rows


def poses(weeks: list[LabWeek]) -> str:
    """How right maps from true, registered and stated poses are about what was there."""
    order = ("true", "registered", "stated")
    header = (
        "location",
        "data",
        *(f"{name} poses" for name in order),
        *(f"{name}, cells that change" for name in order),
    )
    rows = []
    for week in weeks:
        for name, maps in week.maps.items():
            known = known_cells(maps)
            changing = np.intersect1d(known, maps.truth.changing())
            shares = [
                number(against_truth(maps, pose, split(week), cells)) for cells in (known, changing) for pose in order
            ]
            rows.append([week.area.name, name, *shares])
    return table(header, rows)


def registration(weeks: list[LabWeek]) -> str:
    """What became of the scans that came with a wrong pose."""
    header = ("location", "data", "scans", "accepted", "wrong of them", "median error", "stated poses")
    return table(header, (_outcomes(week, name, week.maps[name]) for week in weeks for name in DIMENSIONS))


def _outcomes(week: LabWeek, name: str, maps: LabMaps) -> list[str]:
    posted = [each for each in maps.posted if each.time >= START + SURVEY_S]
    accepted = [each for each in posted if each.verdict == "accepted"]
    return [
        week.area.name,
        name,
        f"{len(posted):,}",
        f"{len(accepted):,}",
        str(sum(each.standing.wrong for each in accepted)),
        _median([each.standing for each in accepted]),
        _median([each.stated for each in posted]),
    ]


def _median(errors: list[Error]) -> str:
    shift, rotation = np.median([(each.shift, each.rotation) for each in errors], axis=0)
    return f"{100 * shift:.1f} cm, {np.degrees(rotation):.2f}°"
