"""One reading of a door, posted and forgotten: what cron runs every minute. Start a server first: `make run`.

* * * * *  python door_by_cron.py
"""

import time
from pathlib import Path

from tidemap import Client
from tidemap.client import TidemapError

SENSOR = Path("/sys/class/gpio/gpio17/value")


def read_door() -> int:
    """1 open, 0 closed; without a sensor the door is open by day."""
    return int(SENSOR.read_text()) if SENSOR.exists() else int(8 <= time.localtime().tm_hour < 18)


now = time.time()
with Client("http://127.0.0.1:8000") as tidemap:
    try:
        tidemap.create_location("cron-door", interval_s=60, time_zone="Europe/London")
    except TidemapError as error:
        # 409: an earlier run made it.
        if error.status != 409:
            raise
    # Run twice in one minute, it stores one reading: the key says that it is the same.
    minute = int(now // 60)
    print(tidemap.location("cron-door").observe(now, read_door(), idempotency_key=f"door-{minute}").accepted)
