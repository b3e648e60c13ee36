"""A robot that observes through an outbox until it is killed; a script that the tests run.

Arguments: the server's URL, the location, the outbox, the file of receipts, the first number. Observation n has three
measurements, at 3n, 3n + 1 and 3n + 2 s. Its number is in the file of receipts, durably, only after `observe`
has returned. Numbers are never used again, and no key is given, so that whatever is stored twice would show.
"""

import logging
import os
import sys
from itertools import count
from pathlib import Path

from app.client import Client, Patience, Queued


def states(number: int) -> list[int]:
    """What observation `number` saw."""
    return [number % 2, number // 2 % 2, number // 4 % 2]


def main(url: str, name: str, outbox: str, receipts: str, first: str) -> None:
    """Observe and write down, without end."""
    logging.disable()
    with Client(url, outbox=outbox, patience=Patience(first_s=0.05, most_s=0.2)) as tidemap:
        place = tidemap.location(name)
        with Path(receipts).open("a") as written:
            for number in count(int(first)):
                assert place.observe([3 * number + i for i in range(3)], states(number)) == Queued(1, 3)
                written.write(f"{number}\n")
                written.flush()
                os.fsync(written.fileno())


if __name__ == "__main__":
    main(*sys.argv[1:])
