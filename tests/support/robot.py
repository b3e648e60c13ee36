"""A robot that observes through an outbox until it is killed, in a process of its own.

A sighting's number is in the file of receipts, durably, only after `observe` has returned. No key is given, so that
whatever is sent twice as something new would show.
"""

import logging
import os
import time
from itertools import count
from pathlib import Path

from tests.support.sightings import Sighting
from tidemap.client import Client, RetryPolicy

BACKLOG = 50
"""Batches that it lets wait before it observes more."""


def observe_for_ever(url: str, outbox: Path, receipts: Path, robot: int, first: int) -> None:
    """Observe and write down, from the sighting with the number `first` on."""
    logging.disable()
    with (
        Client(url, outbox=outbox, retry=RetryPolicy(first_s=0.05, max_s=0.2)) as client,
        receipts.open("a") as written,
    ):
        for number in count(first):
            Sighting(robot, number).post(client)
            written.write(f"{number}\n")
            written.flush()
            os.fsync(written.fileno())
            while client.outbox.pending.batches >= BACKLOG:
                time.sleep(0.01)
