"""predict_calendar: as predict, for a spectrum of `calendar`: a logit, civil time, 32 components of 52 waves."""

from dataclasses import replace

from tests.bench.figures.predict import beside_copying, grid
from tests.bench.timing import Figure

N_WAVES, ORDER = 52, 32


def measure() -> Figure:
    return beside_copying(replace(grid(N_WAVES, ORDER), link="logit", time_zone="Europe/London"))
