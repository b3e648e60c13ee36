"""Who is where: the rhythm of the day and of the week, with the small accidents of every day."""

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

from tidemap.demo.chance import draw
from tidemap.demo.civil import SATURDAY, TUESDAY, Moment

WEEKLY_MEETING = (TUESDAY, 10.0, 11.0)
MEETING_SLOT_H = 1.0


class Whereabouts(Enum):
    """Where somebody can be."""

    DESK = "desk"
    KITCHEN = "kitchen"
    MEETING = "meeting"
    AWAY = "away"


@dataclass(frozen=True, slots=True)
class Habits:
    """The usual hours of one person. `eats_in`: the seat in the kitchen, None for somebody who goes out."""

    arrives: float
    leaves: float
    lunch: float
    eats_in: int | None
    meets: bool
    saturdays: float = 0.0


OFFICE_TEAM = (
    Habits(8.0, 16.9, 12.0, 0, meets=True),
    Habits(8.5, 17.3, 12.0, 1, meets=True),
    Habits(8.5, 17.5, 13.1, 2, meets=False),
    Habits(9.1, 18.0, 13.1, 0, meets=False),
)
LAB_TEAM = (
    Habits(8.2, 16.7, 12.0, 2, meets=True),
    Habits(8.9, 17.4, 12.0, None, meets=True),
    Habits(9.4, 18.2, 13.1, 1, meets=False, saturdays=0.9),
)
ABSENT = 0.04
LUNCH_H = 1.0
COFFEE_H = 1 / 3
MEETINGS = 0.4
"""How likely somebody meets in a slot that is not the weekly meeting's."""


@dataclass(frozen=True, slots=True)
class Day:
    """One person's day in local hours; `arrives` is after `leaves` for a day off."""

    arrives: float
    leaves: float
    lunch: float
    coffee: float
    tea: float


@lru_cache(maxsize=4096)
def day_of(habits: Habits, weekday: int, *key: int) -> Day:
    """What becomes of the habits on the day of a key: minutes early and late, and days off."""
    works = draw(*key, 0) >= ABSENT if weekday < SATURDAY else draw(*key, 0) < _weekend(habits, weekday)
    if not works:
        return Day(24.0, 0.0, 0.0, 0.0, 0.0)
    early, late, hungry, thirsty = (draw(*key, i) - 0.5 for i in (1, 2, 3, 4))
    if weekday == SATURDAY:
        return Day(10.2 + 0.5 * early, 14.0 + 0.5 * late, 0.0, 12.0 + 0.5 * hungry, 0.0)
    return Day(
        habits.arrives + 0.5 * early,
        habits.leaves + 0.5 * late,
        habits.lunch + 0.2 * hungry,
        habits.lunch - 2 + thirsty,
        habits.lunch + 2.5 + thirsty,
    )


def _weekend(habits: Habits, weekday: int) -> float:
    return habits.saturdays if weekday == SATURDAY else 0.0


def whereabouts(habits: Habits, now: Moment, *key: int) -> Whereabouts:
    """Where somebody with these habits is. `key` names the person (and the world)."""
    day = day_of(habits, now.weekday, *key, now.day)
    if not day.arrives <= now.hour < day.leaves:
        return Whereabouts.AWAY
    if habits.meets and in_weekly_meeting(now):
        return Whereabouts.MEETING
    if day.lunch <= now.hour < day.lunch + LUNCH_H:
        return Whereabouts.AWAY if habits.eats_in is None else Whereabouts.KITCHEN
    if habits.eats_in is not None and any(0 <= now.hour - cup < COFFEE_H for cup in (day.coffee, day.tea)):
        return Whereabouts.KITCHEN
    return Whereabouts.DESK


def in_weekly_meeting(now: Moment) -> bool:
    """Tuesday from ten to eleven."""
    weekday, start, stop = WEEKLY_MEETING
    return now.weekday == weekday and start <= now.hour < stop


def guests(now: Moment, n_seats: int, *key: int) -> int:
    """How many of the seats are taken at a meeting that is not the weekly one; none without a meeting."""
    if not now.workday or not 9 <= now.hour < 17 or in_weekly_meeting(now):
        return 0
    slot = int(now.hour / MEETING_SLOT_H)
    meets = draw(*key, now.day, slot, 0) < MEETINGS
    return n_seats - int(2 * draw(*key, now.day, slot, 1)) if meets else 0


def hours(team: tuple[Habits, ...], weekday: int, day: int, *key: int) -> tuple[float, float]:
    """The local hours [start, stop) in which somebody of a team is there on a day; (24, 0) if nobody is."""
    days = [day_of(habits, weekday, *key, person, day) for person, habits in enumerate(team)]
    return min(each.arrives for each in days), max(each.leaves for each in days)
