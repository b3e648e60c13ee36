"""Whether a person was seen, the paper's Lab-1D: what waves can say of it, and what remains to chance."""

from collections.abc import Iterator

import numpy as np

from docs.paper.document import number, table
from docs.paper.lab_scores import accuracy
from docs.paper.lab_week import BASE, ORDER, START
from tidemap.demo.areas import AREAS, Area
from tidemap.demo.civil import DAY_S, moment
from tidemap.demo.robot import INTERVAL_S
from tidemap.demo.visits import Visitor
from tidemap.demo.world import World
from tidemap.history import bits
from tidemap.history.history import History
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.recipe import Recipe

ORDERS = (5, ORDER, 40)


def table_of_people(seed: int, days: float) -> str:
    """By area: how often it changes, how right spectra of some orders are of it, and who knows the people's plans."""
    spectra = (f"order {order}" for order in ORDERS)
    header = ("location", "a person was seen", "changes", *spectra, "who knows the plans")
    visitor = Visitor(World(seed))
    return table(header, (_row(visitor, area, days) for area in AREAS))


def _row(visitor: Visitor, area: Area, days: float) -> list[str]:
    visits = dict(_visits(visitor, area, days))
    time, seen = np.array([*visits]), np.array([*visits.values()], np.uint8)
    first = int(START // INTERVAL_S)
    history = History.empty(1, first, int(days * DAY_S / INTERVAL_S))
    sample = (time // INTERVAL_S).astype(np.int64) - first
    bits.put(history.observed, history.occupied, np.zeros(len(time), np.int64), sample, seen)
    right = [accuracy(fit_recipe(history, Recipe("fft", order), BASE), history) for order in ORDERS]
    known = np.mean([_expected(visitor.world, area, each) == visits[each] for each in visits])
    changes = int(np.count_nonzero(np.diff(seen)))
    return [area.name, f"{100 * seen.mean():.0f} %", str(changes), *map(number, right), number(float(known))]


def _visits(visitor: Visitor, area: Area, days: float) -> Iterator[tuple[float, bool]]:
    """The time of every visit, and whether a person was seen."""
    for time in np.arange(START, START + days * DAY_S, INTERVAL_S).tolist():
        person = visitor.person(area, time)
        if person is not None:
            yield time, person


def _expected(world: World, area: Area, time: float) -> bool:
    """Whether somebody is likelier seen than not, by the seats that are taken and how often people walk through."""
    return not world.taken(time).isdisjoint(area.seats) or area.passes(moment(time)) > 0.5
