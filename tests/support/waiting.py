"""Waiting for what will be."""

import time
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")

WAIT_S = 120.0
"""Long enough for a machine that is ten times slower."""


def until(condition: Callable[[], Value | None]) -> Value:
    """Wait until it holds; what it says then."""
    deadline = time.monotonic() + WAIT_S
    while not (value := condition()):
        assert time.monotonic() < deadline, "it did not come to that"
        time.sleep(0.005)
    return value
