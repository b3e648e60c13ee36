"""Civil time: what the clock on the wall of a time zone shows, in seconds to compute with, and public holidays."""

from datetime import UTC, datetime
from functools import lru_cache
from threading import Lock
from zoneinfo import ZoneInfo

import holidays
import numpy as np
from numpy.typing import NDArray

MONDAY_S = 4 * 86_400.0
"""1970-01-05, a Monday, in seconds after 1970-01-01, both at midnight of the same clock."""

STEP_S = 900.0
"""Offsets from UTC change on whole quarters of an hour."""
DAY_S = 86_400.0
DAYS_A_WEEK = 7
WEEK_S = DAYS_A_WEEK * DAY_S
SUNDAY = 6


def civil_seconds(time: NDArray[np.float64], time_zone: str) -> NDArray[np.float64]:
    """Seconds the local clock has counted from midnight of Monday, 5 January 1970; any shape.

    `time` is in Unix seconds, `time_zone` an IANA name (ZoneInfoNotFoundError if unknown). One
    look-up per quarter of an hour that occurs.

    >>> float(civil_seconds(np.array(1_717_200_000.0), "Europe/London") % 86_400)  # 2024-06-01 00:00Z
    3600.0
    """
    step, inverse = np.unique(np.floor(time / STEP_S), return_inverse=True)
    offset = np.array([_utc_offset_s(float(each) * STEP_S, time_zone) for each in step])
    return np.asarray(time + offset[inverse].reshape(time.shape) - MONDAY_S)


def week_seconds(time: NDArray[np.float64], time_zone: str, calendar: str | None) -> NDArray[np.float64]:
    """Civil seconds in which a public holiday of `calendar` is the Sunday of its week; as `civil_seconds` without one.

    >>> christmas, sunday = 1_734_955_200.0 + 2 * DAY_S, 1_734_955_200.0 + 6 * DAY_S  # 2024-12-25 and 29, 12:00Z
    >>> seconds = week_seconds(np.array([christmas, sunday]), "Europe/London", "GB-ENG")
    >>> bool(seconds[0] == seconds[1])
    True
    """
    seconds = civil_seconds(time, time_zone)
    if calendar is None:
        return seconds
    day = np.floor_divide(seconds, DAY_S).astype(np.int64)
    return np.asarray(seconds + (weekdays(day, calendar) - day % DAYS_A_WEEK) * DAY_S)


def weekdays(day: NDArray[np.int64], calendar: str | None) -> NDArray[np.int64]:
    """The weekday of days since Monday, 5 January 1970: 0 Monday … 6 Sunday; 6 on a public holiday of `calendar`.

    calendar: an ISO 3166 code, of a country (`GB`) or of a part of one (`GB-ENG`).
    """
    weekday = day % DAYS_A_WEEK
    if calendar is None:
        return weekday
    named, inverse = np.unique(day, return_inverse=True)
    off = np.array([_is_holiday(int(each), calendar) for each in named], np.bool_)
    return np.where(off[inverse].reshape(day.shape), SUNDAY, weekday)


def knows_calendar(calendar: str) -> bool:
    """Whether there is a calendar of public holidays of this code."""
    country, _, part = calendar.partition("-")
    parts = holidays.list_supported_countries(include_aliases=False)
    return country in parts and (not part or part in parts[country])


_FILLING = Lock()


@lru_cache(maxsize=1 << 16)
def _is_holiday(day: int, calendar: str) -> bool:
    date = datetime.fromtimestamp(day * DAY_S + MONDAY_S, UTC).date()
    # A calendar that is asked about a new year says no to others until it has filled it.
    with _FILLING:
        return date in _holidays(calendar)


@lru_cache(maxsize=64)
def _holidays(calendar: str) -> holidays.HolidayBase:
    country, _, part = calendar.partition("-")
    return holidays.country_holidays(country, subdiv=part or None)


@lru_cache(maxsize=1 << 16)
def _utc_offset_s(time: float, time_zone: str) -> float:
    offset = datetime.fromtimestamp(time, ZoneInfo(time_zone)).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()
