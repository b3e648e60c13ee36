"""Numbers, times and periods in the words of people who run robots."""

from collections.abc import Sequence
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

MINUTE_S, HOUR_S, DAY_S, WEEK_S = 60.0, 3600.0, 86400.0, 604800.0
_STEPS = (
    (90.0, 1.0, "s"),
    (90 * MINUTE_S, MINUTE_S, "min"),
    (36 * HOUR_S, HOUR_S, "h"),
    (60 * DAY_S, DAY_S, "days"),
    (float("inf"), 30.44 * DAY_S, "months"),
)
VERDICTS = ("free", "occupied", "uncertain")
"""What verdicts mean, by their codes."""
ABOUT_S = 5 * MINUTE_S
KINDS = {"state": "state", "grid2d": "2D grid", "grid3d": "3D grid"}


def relative(time_s: float, now_s: float) -> str:
    """How long ago, or in how long.

    >>> relative(0, 30), relative(0, 7200), relative(86400 * 3, 0), relative(5, 0)
    ('30 s ago', '2 h ago', 'in 3 days', 'just now')
    """
    away = abs(now_s - time_s)
    if away < 10:
        return "just now"
    size, unit = next((size, unit) for limit, size, unit in _STEPS if away < limit)
    text = f"{away / size:.0f} {unit}"
    return f"{text} ago" if time_s < now_s else f"in {text}"


def local_time(time_s: float, zone: str) -> str:
    """A moment as a clock in that time zone shows it, with the zone's abbreviation.

    >>> local_time(1772528400, "Europe/London")
    'Tue 3 Mar 2026, 09:00:00 GMT'
    """
    moment = datetime.fromtimestamp(time_s, ZoneInfo(zone))
    return f"{moment:%a} {moment.day} {moment:%b %Y, %H:%M:%S %Z}"


def iso(time_s: float) -> str:
    """A moment as ISO 8601 in UTC.

    >>> iso(1772528400)
    '2026-03-03T09:00:00Z'
    """
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%dT%H:%M:%SZ}"


def about(time_s: float, now_s: float, zone: str) -> str:
    """A time to come on a clock in that time zone, to five minutes, with the weekday where it is not today.

    >>> about(1772525460, 1772500000, "Europe/London"), about(1772525460, 1772480000, "Europe/London")
    ('08:10', 'Tue 08:10')
    """
    moment = datetime.fromtimestamp(round(time_s / ABOUT_S) * ABOUT_S, ZoneInfo(zone))
    today = datetime.fromtimestamp(now_s, ZoneInfo(zone)).date()
    return f"{moment:%H:%M}" if moment.date() == today else f"{moment:%a %H:%M}"


def duration(seconds: float) -> str:
    """A length of time in its natural unit.

    >>> duration(86400), duration(604800), duration(43200), duration(300), duration(29030.4), duration(0.5)
    ('24 h', '7 d', '12 h', '5 min', '8.06 h', '0.5 s')
    """
    if seconds < 100:
        return f"{seconds:.3g} s"
    if seconds < HOUR_S:
        return f"{seconds / MINUTE_S:.3g} min"
    if seconds < 47 * HOUR_S:
        return f"{seconds / HOUR_S:.3g} h"
    return f"{seconds / DAY_S:.3g} d"


def count(number: int) -> str:
    """A whole number with thousands apart.

    >>> count(1234567)
    '1,234,567'
    """
    return f"{number:,}"


def percent(share: float | None) -> str:
    """A share in percent, or a dash.

    >>> percent(0.9712), percent(None)
    ('97.1 %', '–')
    """
    return "–" if share is None else f"{100 * share:.1f} %"


def metres(length: float) -> str:
    """A length in metres, without needless digits.

    >>> metres(0.05), metres(12.0)
    ('0.05 m', '12 m')
    """
    return f"{length:.4g} m"


def cells(shape: Sequence[int]) -> str:
    """A grid's shape.

    >>> cells([40, 30, 8])
    '40 × 30 × 8'
    """
    return " × ".join(count(side) for side in shape)
