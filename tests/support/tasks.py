"""Tasks for executors, in a module that other processes can load."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from tests.support.waiting import WAIT_S
from tidemap.services.context import Context


@dataclass(frozen=True)
class Held:
    """A task that says in `folder` that it has begun, and ends once there is a file `go` there."""

    folder: Path
    number: int


def hold(_: Context, task: Held) -> int:
    """The task's number."""
    (task.folder / f"begun-{task.number}-{os.getpid()}").touch()
    deadline = time.monotonic() + WAIT_S
    while not (task.folder / "go").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return task.number


def negate(_: Context, number: int) -> int:
    """The other one."""
    return -number


def die(_: Context, number: int) -> int:
    """It takes its process along."""
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def refuse(_: Context, error: Exception) -> None:
    """It fails."""
    raise error
