"""Learning how often a sensor errs, and how long states last that it reads, from the readings of a history.

The states are taken for a chain of two that is redrawn from the rhythm at a constant rate (a hidden Markov model). Its
rate and the sensor's rates are the mode of the likelihood of the readings under normal priors. The runs that the
smoothed chain believes in give the durations.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit

from tidemap.history.jit import kernel
from tidemap.history.sequences import Sequences
from tidemap.spectral.conditioning import MIN_PROBABILITY, UNLEARNED
from tidemap.spectral.detector import Detector
from tidemap.spectral.durations import BelievedRuns, Durations
from tidemap.spectral.sensor import MAX_RATE, Sensor, weighed

MAX_READINGS: Final = 100_000
"""Of all cells together, the latest of each."""
MIN_READINGS: Final = 200
"""Fewer say too little of rates."""
BELIEVED: Final = Sensor(miss=0.05, false_alarm=0.05)
"""What is believed of a sensor without having learned, and the middle of the prior."""
RATE_SD: Final = 1.5
"""Of the prior of logit(rate / MAX_RATE)."""
REDRAWN_SD: Final = 2.0
"""Of the prior of the logarithm of the rate at which states are redrawn."""


@dataclass(frozen=True, slots=True, eq=False)
class ReadCells:
    """The readings of some cells, and the rhythm's probability of an occupied one at each of them, (n,) float64."""

    sequences: Sequences
    p: NDArray[np.float64]


def learn_detector(read: ReadCells, interval_s: float, given: Sensor | None = None) -> Detector:
    """The sensor, unless it is given, and how long states last."""
    some = _latest(read)
    n_readings, n_cells = len(some.sequences.sample), int((some.sequences.count > 0).sum())
    if n_readings < MIN_READINGS:
        reason = "the rates were given" if given else _too_few(n_readings)
        return Detector(given or BELIEVED, Durations.believed(interval_s), 0, reason)
    sensor, rate = _chain_of(some, interval_s, given)
    durations = Durations.learned(_runs(some, sensor, rate), interval_s)
    if given:
        return Detector(given, durations, 0, "the rates were given")
    reason = f"the rates were learned from {n_readings} readings of {n_cells} {'cell' if n_cells == 1 else 'cells'}"
    return Detector(sensor, durations, n_readings, reason)


def _too_few(n_readings: int) -> str:
    return (
        f"{n_readings} readings are too few to learn the rates from, which takes {MIN_READINGS}; a miss and a false "
        f"alarm of {BELIEVED.miss} are assumed"
    )


def _latest(read: ReadCells) -> ReadCells:
    """`MAX_READINGS` readings at most, without those of cells that the model does not know."""
    known = ~np.isnan(read.p)
    sequences, p = read.sequences.select(known), read.p[known]
    kept = sequences.latest(max(1, MAX_READINGS // max(1, sequences.n_cells)))
    return ReadCells(sequences.select(kept), p[kept])


def _chain_of(read: ReadCells, interval_s: float, given: Sensor | None) -> tuple[Sensor, float]:
    """The sensor, and how often a sample states are redrawn."""
    usual = logit(np.array([] if given else [BELIEVED.miss, BELIEVED.false_alarm]) / MAX_RATE)
    redrawn = np.log(interval_s / UNLEARNED.tau_s)
    filtered, ahead = np.empty(len(read.p)), np.empty(len(read.p))
    columns = (read.sequences.offset, read.sequences.sample, read.sequences.state)

    def sensor_of(theta: NDArray[np.float64]) -> Sensor:
        return given or Sensor(*(MAX_RATE * expit(theta[1:])).tolist())

    def cost(theta: NDArray[np.float64]) -> float:
        sensor = sensor_of(theta)
        rhythm = _rhythm(sensor, read)
        fits = _forward(*columns, rhythm, sensor.bounded, float(np.exp(theta[0])), filtered, ahead)
        off = ((theta[0] - redrawn) / REDRAWN_SD) ** 2 + np.square((theta[1:] - usual) / RATE_SD).sum()
        return float(off / 2 - fits)

    start = np.concatenate(([redrawn], usual))
    bounds = [(redrawn - 12, redrawn + 12), *((-8.0, 6.0) for _ in usual)]
    found = minimize(cost, start, method="L-BFGS-B", bounds=bounds).x
    return sensor_of(found), float(np.exp(found[0]))


def _rhythm(sensor: Sensor, read: ReadCells) -> NDArray[np.float64]:
    return np.clip(sensor.state_probability(read.p), MIN_PROBABILITY, 1 - MIN_PROBABILITY)


def _runs(read: ReadCells, sensor: Sensor, rate: float) -> BelievedRuns:
    """The runs of states that the smoothed chain believes in, each from the middle between two readings to another."""
    sequences, rhythm = read.sequences, _rhythm(sensor, read)
    filtered, ahead = np.empty(len(read.p)), np.empty(len(read.p))
    columns = (sequences.offset, sequences.sample)
    _forward(*columns, sequences.state, rhythm, sensor.bounded, rate, filtered, ahead)
    _smooth(*columns, rhythm, rate, ahead, filtered)
    occupied, cell = filtered > 0.5, sequences.cell
    first = np.concatenate(([True], (np.diff(occupied) != 0) | (np.diff(cell) != 0)))
    begin = np.flatnonzero(first)
    end = np.concatenate((begin[1:], [len(cell)])) - 1
    opened = np.concatenate(([False], cell[begin[1:]] == cell[begin[1:] - 1]))
    closed = np.concatenate((opened[1:], [False]))
    border = np.where(opened, (sequences.sample[begin] + sequences.sample[begin - 1]) / 2, sequences.sample[begin])
    after = np.concatenate((border[1:], [0.0]))
    length = np.where(closed, after, sequences.sample[end]) - border
    mean = np.bincount(cell, rhythm, sequences.n_cells)[cell[begin]] / sequences.count[cell[begin]]
    state = occupied[begin].astype(np.uint8)
    return BelievedRuns(state, np.maximum(length, 1.0), opened & closed, np.where(state == 1, 1 - mean, mean))


@kernel
def _forward(
    offset: NDArray[np.int64],
    sample: NDArray[np.int64],
    state: NDArray[np.uint8],
    rhythm: NDArray[np.float64],
    rates: tuple[float, float],
    rate: float,
    filtered: NDArray[np.float64],
    ahead: NDArray[np.float64],
) -> float:
    """The log likelihood of the readings by the chain. ahead, filtered: P(occupied) before and after each reading."""
    total = 0.0
    for cell in range(offset.size - 1):
        for j in range(offset[cell], offset[cell + 1]):
            before = rhythm[j]
            if j > offset[cell]:
                kept = np.exp(-rate * (sample[j] - sample[j - 1]))
                before = kept * filtered[j - 1] + (1 - kept) * rhythm[j]
            occupied, free = weighed(before, state[j], rates)
            ahead[j], filtered[j] = before, occupied / (occupied + free)
            total += np.log(occupied + free)
    return total


@kernel
def _smooth(
    offset: NDArray[np.int64],
    sample: NDArray[np.int64],
    rhythm: NDArray[np.float64],
    rate: float,
    ahead: NDArray[np.float64],
    filtered: NDArray[np.float64],
) -> None:
    """In place: P(occupied) given all readings of the cell, from that given those up to each."""
    for cell in range(offset.size - 1):
        for j in range(offset[cell + 1] - 2, offset[cell] - 1, -1):
            kept = np.exp(-rate * (sample[j + 1] - sample[j]))
            redrawn = (1 - kept) * rhythm[j + 1]
            occupied, free = filtered[j + 1] / ahead[j + 1], (1 - filtered[j + 1]) / (1 - ahead[j + 1])
            filtered[j] *= (kept + redrawn) * occupied + (1 - kept - redrawn) * free
