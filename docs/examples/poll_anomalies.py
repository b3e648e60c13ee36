"""A dashboard that asks for what is new now and then. Start a server first: `make run`.

The id of the last anomaly is all that it has to remember: `after` resumes behind it, so that none is missed or shown
twice. To be told at once instead, see follow_events.py.
"""

import time

from tidemap import Client

HOUR = 3600
POLLS, PAUSE_S = 3, 1.0


def post_days(tidemap: Client) -> None:
    """Four weeks of a door that is closed at night, and one night when it is not."""
    door = tidemap.create_location("polled-door", interval_s=HOUR, confidence=0.8)
    hours = range(28 * 24)
    door.observe([float(hour * HOUR) for hour in hours], [8 <= hour % 24 < 18 for hour in hours])
    door.update()
    door.observe(float((28 * 24 + 3) * HOUR), 1)


with Client("http://127.0.0.1:8000") as tidemap:
    post_days(tidemap)
    last = 0
    for _ in range(POLLS):
        for event in tidemap.location("polled-door").anomalies(after=last):
            last = max(last, event.id or 0)
            print(f"{event.location} at {event.start:.0f}: observed {event.observed}, expected {event.probability:.2f}")
        time.sleep(PAUSE_S)
