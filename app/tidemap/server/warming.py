"""Kernels ready before the first request: what this machine lacks is compiled by a process that ends after it."""

import logging
import subprocess
import sys
from typing import NoReturn

from numba.core.event import Event, Listener, install_listener

from tidemap.services.warm import warm

log = logging.getLogger(__name__)


class _MissingError(Exception):
    """A kernel is not in the cache on disk."""


class _Refusal(Listener):
    """Keeps this process from compiling anything."""

    def on_start(self, event: Event) -> NoReturn:
        """Compiling is about to begin."""
        raise _MissingError

    def on_end(self, event: Event) -> None:
        """Nothing was compiled."""


def warm_up() -> None:
    """Load every kernel from the cache on disk, and fill the cache first where it is empty.

    A compiler leaves about 140 MB behind in the process that ran it, so another process runs it. Where that fails,
    or where the cache cannot be written, this process compiles for itself.
    """
    if not _loaded():
        log.info("compiling kernels for this machine, once: about a minute")
        subprocess.run([sys.executable, "-m", "tidemap.services.warm"], check=False)
        warm()


def _loaded() -> bool:
    try:
        with install_listener("numba:compile", _Refusal()):
            warm()
    except _MissingError:
        return False
    return True
