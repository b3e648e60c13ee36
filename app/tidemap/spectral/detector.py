"""Detectors: a sensor that errs with what it reads, as an update stores it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tidemap.spectral.durations import Durations
from tidemap.spectral.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class Detector:
    """A sensor that errs, and how long the states last that it reads.

    readings: how many its rates were learned from, 0 where they were given or are what is believed. reason: where they
    come from, in words.
    """

    sensor: Sensor
    durations: Durations
    readings: int = 0
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """As plain JSON; the logarithms to six digits."""
        log_kept = self.durations.log_kept.round(6).tolist()
        return {**asdict(self.sensor), "log_kept": log_kept, "readings": self.readings, "reason": self.reason}

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> "Detector":
        """The inverse of `as_dict`. ValueError, TypeError or KeyError where it is none."""
        sensor = Sensor(value["miss"], value["false_alarm"])
        return cls(sensor, Durations(np.array(value["log_kept"], np.float64)), value["readings"], value["reason"])
