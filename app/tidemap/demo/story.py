"""What happens once: the plant that is moved, and the two planted anomalies."""

from dataclasses import dataclass
from typing import TypeAlias

from tidemap.demo.civil import DAY_S, FRIDAY, last

Span: TypeAlias = tuple[float, float]
NEVER: Span = (0.0, 0.0)
PLANT_STAYS_S = 4 * DAY_S
"""Early enough to lie before the two weeks a spectrum is fitted to. A transform repeats what it was fitted to: a
move within its window it expects to be undone when the window begins anew, and would call the plant an anomaly."""
NIGHT = 2 + 10 / 60, 2 + 25 / 60
AFTERNOON = 13.75, 16.25
"""Local hours of the planted anomalies."""


@dataclass(frozen=True, slots=True)
class Story:
    """`plant_moves` at Unix seconds; office door open at night and office empty in spans [start, stop)."""

    plant_moves: float = 0.0
    door_open: tuple[Span, ...] = ()
    office_empty: Span = NEVER

    def happening(self, time: float) -> bool:
        """Whether one of the planted anomalies is going on."""
        return self.door_left_open(time) or within(time, self.office_empty)

    def door_left_open(self, time: float) -> bool:
        """Whether the office door stands open at night."""
        return any(within(time, night) for night in self.door_open)


def within(time: float, span: Span) -> bool:
    """Whether `time` is in [start, stop)."""
    return span[0] <= time < span[1]


def planted(start: float, now: float) -> Story:
    """The story of a building first seen at `start`: the last two nights and the last Friday before `now`."""
    night = last(*NIGHT, now)
    return Story(
        plant_moves=start + PLANT_STAYS_S,
        door_open=(last(*NIGHT, night[0]), night),
        office_empty=last(*AFTERNOON, now, FRIDAY),
    )
