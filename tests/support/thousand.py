"""A thousand locations in one building, some of the first with a week of readings and a model."""

import numpy as np
from numpy.typing import NDArray

from tests.support.contexts import post_states, refit
from tests.support.rows import VALUES
from tidemap.services.context import Context

DAY_S = 86400.0
HOUR_S = 3600.0
WEEK = np.arange(0.0, 7 * DAY_S, HOUR_S)
COUNT = 1000


def open_by_day(now: float) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """A week before now, occupied from 8 to 18 UTC."""
    times = (now - 7 * DAY_S) // HOUR_S * HOUR_S + HOUR_S + WEEK
    hour = times % DAY_S / HOUR_S
    return times, ((hour >= 8) & (hour < 18)).astype(np.uint8)


def fill(ctx: Context, now: float, modelled: int) -> None:
    """The first `modelled` by their names have a model."""
    names = [f"building-{number // 200}-floor-{number % 5}-door-{number:04}" for number in range(COUNT)]
    values = [VALUES | {"name": name, "interval_s": HOUR_S, "epoch": 0.0} for name in names]
    ctx.store.write(lambda work: [work.locations.create(each) for each in values])
    times, states = open_by_day(now)
    for name in sorted(names)[:modelled]:
        post_states(ctx, name, times, states)
        refit(ctx, name, estimator="fft", order=3)
