"""A robot that observes through an outbox until it is killed; a script that the tests run.

Arguments: the server's URL, the outbox, the file of receipts, the robot's number and that of its first sighting. A
sighting's number is in the file of receipts, durably, only after `observe` has returned. No key is given, so that
whatever is sent twice as something new would show.
"""

import logging
import os
import sys
import time
from itertools import count
from pathlib import Path

from tests.support.sightings import Sighting
from tidemap.client import Client, RetryPolicy

BACKLOG = 50
"""Batches that it lets wait before it observes more."""


def main(url: str, outbox: str, receipts: str, robot: str, first: str) -> None:
    """Observe and write down, without end."""
    logging.disable()
    with (
        Client(url, outbox=outbox, retry=RetryPolicy(first_s=0.05, max_s=0.2)) as client,
        Path(receipts).open("a") as written,
    ):
        for number in count(int(first)):
            Sighting(int(robot), number).post(client)
            written.write(f"{number}\n")
            written.flush()
            os.fsync(written.fileno())
            while client.outbox.pending.batches >= BACKLOG:
                time.sleep(0.01)


if __name__ == "__main__":
    main(*sys.argv[1:])
