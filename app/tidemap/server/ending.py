"""Ending: a process that is to stop ends in time, though its database does not answer."""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable

log = logging.getLogger(__name__)
PREFIX = "tidemap-"
IDLE = "concurrent/futures/thread.py"
"""Where a thread of a pool waits for work."""


def end_within(seconds: float, waiting: Callable[[], int]) -> None:
    """Have this process end by force where it has not ended in so long, with status 1; the log says what was left.

    `waiting`: how many writes wait. Nobody was answered that one of those is stored, so nothing acknowledged is lost.
    """
    threading.Thread(target=_end, args=(seconds, waiting), name=f"{PREFIX}end", daemon=True).start()


def _end(seconds: float, waiting: Callable[[], int]) -> None:
    time.sleep(seconds)
    log.error(
        "Tidemap did not end within %g s, as its database does not answer, and ends by force. At work: %s; %d writes "
        "waited. Nothing that was acknowledged is lost.",
        seconds,
        ", ".join(at_work()) or "requests",
        waiting(),
    )
    logging.shutdown()
    sys.stdout.flush()
    os._exit(1)


def at_work() -> list[str]:
    """The names of the threads of this program that do something, or wait for an answer, but this one."""
    frames = sys._current_frames()
    others = (each for each in threading.enumerate() if each is not threading.current_thread())
    return sorted(
        each.name.removeprefix(PREFIX)
        for each in others
        if each.name.startswith(PREFIX)
        and each.ident in frames
        and not frames[each.ident].f_code.co_filename.endswith(IDLE)
    )
