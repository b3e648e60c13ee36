"""Who is where: the rhythm of the day and of the week, with the small accidents of every day."""

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

from app.demo.chance import draw
from app.demo.civil import FRIDAY, SATURDAY, TUESDAY, Moment

WEEKLY_MEETING = (TUESDAY, 10.0, 11.0)
MEETING_SLOT_H = 0.5


class Place(Enum):
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
    Habits(7.9, 16.9, 12.0, 0, meets=True),
    Habits(8.5, 17.4, 12.0, 1, meets=True),
    Habits(8.8, 17.9, 13.0, None, meets=False),
    Habits(9.2, 18.4, 13.0, 2, meets=False),
)
LAB_TEAM = (
    Habits(8.2, 16.6, 12.5, 2, meets=True),
    Habits(9.0, 17.6, 12.5, None, meets=True),
    Habits(9.6, 19.0, 13.4, 1, meets=False, saturdays=0.5),
)
ABSENT = 0.05
LUNCH_H = 0.75
COFFEE_H = 0.25


@dataclass(frozen=True, slots=True)
class Day:
    """One person's day in local hours; `arrives` is after `leaves` for a day off."""

    arrives: float
    leaves: float
    lunch: float
    coffee: float


@lru_cache(maxsize=4096)
def day_of(habits: Habits, weekday: int, *key: int) -> Day:
    """What becomes of the habits on the day of a key: minutes early and late, and days off."""
    works = draw(*key, 0) >= ABSENT if weekday < SATURDAY else draw(*key, 0) < _weekend(habits, weekday)
    if not works:
        return Day(24.0, 0.0, 0.0, 0.0)
    early, late, hungry, thirsty = (draw(*key, i) - 0.5 for i in (1, 2, 3, 4))
    leaves = 16.75 if weekday == FRIDAY else habits.leaves
    if weekday == SATURDAY:
        return Day(10.2 + early, 14.0 + late, 0.0, 12.0 + hungry)
    return Day(
        habits.arrives + 0.5 * early,
        leaves + 0.5 * late,
        habits.lunch + 0.2 * hungry,
        (15.2 if weekday != FRIDAY else 10.5) + thirsty,
    )


def _weekend(habits: Habits, weekday: int) -> float:
    return habits.saturdays if weekday == SATURDAY else 0.0


def place(habits: Habits, now: Moment, *key: int) -> Place:
    """Where somebody with these habits is. `key` names the person (and the world)."""
    day = day_of(habits, now.weekday, *key, now.day)
    if not day.arrives <= now.hour < day.leaves:
        return Place.AWAY
    if habits.meets and in_weekly_meeting(now):
        return Place.MEETING
    if day.lunch <= now.hour < day.lunch + LUNCH_H:
        return Place.AWAY if habits.eats_in is None else Place.KITCHEN
    if habits.eats_in is not None and day.coffee <= now.hour < day.coffee + COFFEE_H:
        return Place.KITCHEN
    return Place.DESK


def in_weekly_meeting(now: Moment) -> bool:
    """Tuesday from ten to eleven."""
    weekday, start, stop = WEEKLY_MEETING
    return now.weekday == weekday and start <= now.hour < stop


def guests(now: Moment, n_seats: int, *key: int) -> tuple[int, ...]:
    """The seats taken at a meeting that is not the weekly one; none without a meeting."""
    if not now.workday or not 9 <= now.hour < 17 or in_weekly_meeting(now):
        return ()
    slot = int(now.hour / MEETING_SLOT_H)
    if draw(*key, now.day, slot) >= 0.35:
        return ()
    return tuple(seat for seat in range(n_seats) if draw(*key, now.day, slot, seat) < 0.6)
