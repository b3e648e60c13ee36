"""Waiting for what will be."""

import time
from collections.abc import Callable

WAIT_S = 120.0
"""Long enough for a machine that is ten times slower."""


def until(condition: Callable[[], bool]) -> None:
    """Wait until it holds."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "it did not come to that"
        time.sleep(0.005)
