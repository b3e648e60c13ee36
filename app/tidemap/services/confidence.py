"""The right confidence: how sure a location has to be, for so many false alarms a week and no more.

What a location's own history would have made of each confidence says it: the paper's IV-B, 'an optimal confidence level
can be calculated from the statistical properties of p(t)'. All of that history is taken to have been in order.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from tidemap.errors import InvalidInputError
from tidemap.services.context import Context
from tidemap.services.detect import search
from tidemap.services.grouping import Criterion
from tidemap.services.history import window
from tidemap.services.parts import SEEN
from tidemap.services.spectra import Fitted, fitted
from tidemap.settings import WEEK_S
from tidemap.spectral.anomaly import Rule

CONFIDENCES = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.925, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998, 0.999)
"""What is tried."""
MAX_VALUES = 1 << 25
"""Cells times samples that are judged at each confidence: of a large map the latest part of its history."""
SURE = 0.9
"""How sure the bounds of a rate are."""


@dataclass(frozen=True, slots=True)
class EventRate:
    """What a confidence gives on the history: `events`, and of a week the mean and bounds that hold with 90 %.

    None of them where there are too many to count.
    """

    confidence: float
    events: int | None
    per_week: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class ConfidenceView:
    """The least confidence that is tried and gives no more than the wanted events a week, on `weeks` of history in
    [start, stop); `reached` says that there is one, else it is the one that gives the fewest. `rates` are of all."""

    rule: Rule
    confidence: float
    reached: bool
    start: float
    stop: float
    weeks: float
    revision: int
    rates: list[EventRate]


def find_confidence(
    ctx: Context, name: str, per_week: float, rule: Rule = "surprise", check: Callable[[], None] = lambda: None
) -> ConfidenceView:
    """Try confidences on a location's history; as many searches. `check` as for `detect`.

    Raises LocationNotFoundError, NoModelError, InvalidInputError, CorruptChunkError.
    """
    model = fitted(ctx, name, part=SEEN)
    base, (first, stop) = model.location.base, window(ctx, model.location)
    start = max(first, stop - MAX_VALUES // max(1, model.spectrum.n_cells), model.revision.start)
    if stop <= start:
        raise InvalidInputError.at("location", f"{name!r} has no observations to try a confidence on; post some first")
    weeks = (stop - start) * model.location.interval_s / WEEK_S
    rates = [
        _rate(ctx, model, (start, stop), Criterion(c, rule, model.revision.revision), weeks, check) for c in CONFIDENCES
    ]
    enough = [rate for rate in rates if rate.per_week is not None and rate.per_week <= per_week]
    chosen = enough[0] if enough else min(rates, key=lambda rate: np.inf if rate.per_week is None else rate.per_week)
    times = float(base.time(start)), float(base.time(stop))
    return ConfidenceView(rule, chosen.confidence, bool(enough), *times, weeks, model.revision.revision, rates)


def _rate(
    ctx: Context,
    model: Fitted,
    samples: tuple[int, int],
    criterion: Criterion,
    weeks: float,
    check: Callable[[], None],
) -> EventRate:
    """What one confidence gives. The bounds are those of a Poisson rate (Garwood, 1936)."""
    try:
        count = len(search(ctx, model, samples, criterion, check))
    except InvalidInputError:
        return EventRate(criterion.confidence, None, None, None, None)
    tail = (1 - SURE) / 2
    low = float(gammaincinv(count, tail)) if count else 0.0
    high = float(gammaincinv(count + 1, 1 - tail))
    return EventRate(criterion.confidence, count, count / weeks, low / weeks, high / weeks)
