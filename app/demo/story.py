"""What happens once: the plant that is moved, and the two planted anomalies."""

from dataclasses import dataclass
from typing import TypeAlias

from app.demo.civil import DAY_S, FRIDAY, last

Span: TypeAlias = tuple[float, float]
NEVER: Span = (0.0, 0.0)
PLANT_STAYS_S = 10 * DAY_S


@dataclass(frozen=True, slots=True)
class Story:
    """`plant_moves` at Unix seconds; office door open at night and office empty are spans [start, stop)."""

    plant_moves: float = 0.0
    door_open: Span = NEVER
    office_empty: Span = NEVER

    def happening(self, time: float) -> bool:
        """Whether one of the planted anomalies is going on."""
        return within(time, self.door_open) or within(time, self.office_empty)


def within(time: float, span: Span) -> bool:
    """Whether `time` is in [start, stop)."""
    return span[0] <= time < span[1]


def planted(start: float, now: float) -> Story:
    """The story of a building first seen at `start`; last night and last Friday are those before `now`."""
    return Story(
        plant_moves=start + PLANT_STAYS_S,
        door_open=last(2 + 10 / 60, 2 + 25 / 60, now),
        office_empty=last(13.75, 16.25, now, FRIDAY),
    )
