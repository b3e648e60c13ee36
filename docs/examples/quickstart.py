"""Four weeks of a front door, then two questions. Start a server first: `make run`."""

# [quickstart]
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

from tidemap import Client

london = ZoneInfo("Europe/London")
start = datetime(2026, 1, 5, tzinfo=london)


def is_open(time: datetime) -> bool:
    local = time.astimezone(london)
    return local.weekday() < 5 and 8 <= local.hour < 18


# What a robot saw every ten minutes for four weeks.
times = [start.astimezone(UTC) + n * timedelta(minutes=10) for n in range(4 * 7 * 144)]

with Client("http://127.0.0.1:8000") as tidemap:
    door = tidemap.create_location("front-door", interval_s=600, time_zone="Europe/London")
    door.observe(time=times, state=[is_open(time) for time in times])
    door.update(wait=True)

    # The Wednesday after, at noon and at three in the night: will it be open?
    asked = ["2026-02-04T12:00:00Z", "2026-02-04T03:00:00Z"]
    print(door.predict(time=asked).probability.round(2))

    # It is open at three in the night, and Tidemap says that this is not normal.
    print(door.observe(time=[asked[1]], state=[1]).anomalies)
# [/quickstart]
