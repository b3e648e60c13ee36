"""Timing a piece of work beside its floor."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Figure:
    """value and floor in `unit`; the aim is on their ratio. `details` are printed as they are."""

    value: float
    floor: float
    aim: float
    unit: str
    details: Mapping[str, float | int | str] = field(default_factory=dict)

    def line(self) -> dict[str, float | int | str]:
        return {
            "value": float(f"{self.value:.4g}"),
            "floor": float(f"{self.floor:.4g}"),
            "ratio": round(self.value / self.floor, 3),
            "aim": self.aim,
            "unit": self.unit,
            **self.details,
        }


def interleaved(
    *work: Callable[[], object], rounds: int = 9, clock: Callable[[], float] = time.perf_counter
) -> list[float]:
    """The least seconds each took, in turns, so that a noisy moment does not fall on one alone."""
    taken: list[list[float]] = [[] for _ in work]
    for each in work:
        each()
    for _ in range(rounds):
        for each, seconds in zip(work, taken, strict=True):
            started = clock()
            each()
            seconds.append(clock() - started)
    return [min(seconds) for seconds in taken]


def quantile(values: Sequence[float], share: float) -> float:
    """The value that this share of them does not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
