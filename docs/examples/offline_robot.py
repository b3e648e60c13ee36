"""A robot that drives out of range: what it observes waits in a file on its disk. Start a server first: `make run`."""

import tempfile
from pathlib import Path

from tidemap import Client

outbox = Path(tempfile.mkdtemp()) / "outbox.db"
with Client("http://127.0.0.1:8000") as tidemap:
    tidemap.create_location("offline-door", interval_s=60)

# Out of range: nothing listens at this address. Each call returns once the reading is on the disk.
with Client("http://127.0.0.1:1", outbox=outbox) as robot:
    for minute in range(5):
        robot.location("offline-door").observe(60.0 * minute, minute % 2)
    print("waiting", robot.outbox.pending.batches)

# Back in range, perhaps after a restart: the same file, and everything is sent once.
with Client("http://127.0.0.1:8000", outbox=outbox) as robot:
    print("sent", robot.outbox.flush(60), "refused", len(robot.outbox.refused()))

with Client("http://127.0.0.1:8000") as tidemap:
    print("stored", tidemap.location("offline-door").get().observations)
