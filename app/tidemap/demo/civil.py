"""Local civil time, by which people live."""

from dataclasses import dataclass
from datetime import date, datetime, timedelta
from datetime import time as clock
from zoneinfo import ZoneInfo

ZONE = "Europe/London"
_ZONE = ZoneInfo(ZONE)
DAY_S = 86400.0

MONDAY, TUESDAY, WEDNESDAY, THURSDAY, FRIDAY, SATURDAY, SUNDAY = range(7)


@dataclass(frozen=True, slots=True)
class Moment:
    """`day` numbers the days as dates do (ordinal), `weekday` is 0 on Mondays, `hour` is in [0, 24)."""

    day: int
    weekday: int
    hour: float

    @property
    def workday(self) -> bool:
        """Monday to Friday."""
        return self.weekday < SATURDAY


def moment(time: float) -> Moment:
    """The local civil time of Unix seconds."""
    local = datetime.fromtimestamp(time, _ZONE)
    hour = local.hour + local.minute / 60 + (local.second + local.microsecond / 1e6) / 3600
    return Moment(local.toordinal(), local.weekday(), hour)


def unix(day: int, hour: float) -> float:
    """Unix seconds of a local hour of a day.

    >>> datetime.fromtimestamp(unix(date(2026, 7, 1).toordinal(), 9.5), ZoneInfo("UTC")).isoformat()
    '2026-07-01T08:30:00+00:00'
    """
    midnight = datetime.combine(date.fromordinal(day), clock())
    return (midnight + timedelta(hours=hour)).replace(tzinfo=_ZONE).timestamp()


def last(start: float, stop: float, now: float, weekday: int | None = None) -> tuple[float, float]:
    """The latest local hours [start, stop) that are over at `now`, on a weekday or any day; Unix seconds."""
    day = moment(now).day
    while unix(day, stop) > now or (weekday is not None and (day - 1) % 7 != weekday):
        day -= 1
    return unix(day, start), unix(day, stop)
