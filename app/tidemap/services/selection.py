"""Selection: how to fit a location, as `auto` chooses where the location leaves it open."""

from collections.abc import Callable

from tidemap.history.history import History
from tidemap.spectral.auto.selection import Choice, choose
from tidemap.storage.records import LocationRecord

SELECTION_CELLS = 64
"""Changing cells that decide for all."""
ORDERS = (1, 2, 3, 5, 10, 15)
"""Orders of `fft` that are tried."""


def settled(location: LocationRecord, estimator: str, order: int | str) -> Choice | None:
    """The choice, without a reason, where estimator and order leave nothing open."""
    if estimator == "static":
        return Choice(estimator, 0, (), "", 0, location.time_zone, calendar=location.calendar)
    if estimator == "fft" and isinstance(order, int):
        return Choice(estimator, order, (), "", 0, location.time_zone, calendar=location.calendar)
    return None


def selected(
    location: LocationRecord, estimator: str, order: int | str, history: History, check: Callable[[], None]
) -> Choice:
    """`auto`, within what estimator and order leave open, by the histories of some changing cells."""
    orders = ORDERS if order == "auto" else (int(order),)
    zone = (location.time_zone, estimator, check, location.calendar)
    return choose(history, location.base, orders, SELECTION_CELLS, *zone)
