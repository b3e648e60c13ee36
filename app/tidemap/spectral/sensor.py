"""Sensors that err: what a reading says of a state where some readings are wrong (DESIGN 2.8)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tidemap.history.jit import kernel

MAX_RATE: Final = 0.5
"""A sensor that is wrong as often as right says nothing."""
MIN_RATE: Final = 1e-4
"""The least that is believed of a rate: no reading is certain."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """How often a sensor errs.

    miss: the share of occupied states that it reads as free. false_alarm: the share of free states that it reads as
    occupied. ValueError where one is not in [0, 0.5).
    """

    miss: float
    false_alarm: float

    def __post_init__(self) -> None:
        if not (0 <= self.miss < MAX_RATE and 0 <= self.false_alarm < MAX_RATE):
            raise ValueError(f"miss and false_alarm lie in [0, {MAX_RATE}), not {self}")

    @property
    def bounded(self) -> tuple[float, float]:
        """miss and false_alarm as they are reckoned with."""
        return max(self.miss, MIN_RATE), max(self.false_alarm, MIN_RATE)

    def state_probability(self, p: ArrayLike) -> NDArray[np.float64]:
        """The probability of an occupied state where readings are occupied with probability p; NaN stays.

        >>> Sensor(miss=0.1, false_alarm=0.1).state_probability([0.0, 0.1, 0.5, 0.9]).round(6).tolist()
        [0.0, 0.0, 0.5, 1.0]
        """
        miss, false_alarm = self.bounded
        return np.asarray(np.clip((np.asarray(p, np.float64) - false_alarm) / (1 - miss - false_alarm), 0.0, 1.0))

    def reading_probability(self, p: ArrayLike) -> NDArray[np.float64]:
        """The probability of an occupied reading where the state is occupied with probability p; NaN stays.

        >>> Sensor(miss=0.1, false_alarm=0.2).reading_probability([0.0, 1.0]).tolist()
        [0.2, 0.9]
        """
        miss, false_alarm = self.bounded
        occupied = np.asarray(p, np.float64)
        return np.asarray(occupied * (1 - miss) + (1 - occupied) * false_alarm)


@kernel
def weighed(p: float, read: int, rates: tuple[float, float]) -> tuple[float, float]:
    """The probabilities of a reading with an occupied state, which has probability p, and with a free one."""
    miss, false_alarm = rates
    return p * (1 - miss if read else miss), (1 - p) * (false_alarm if read else 1 - false_alarm)
