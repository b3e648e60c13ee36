"""Memory: how the C library of this process hands out memory and gives it back."""

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pyarrow as pa

from tidemap.workers.worker import Worker

ARENAS = 2
"""Heaps that threads share; by default every thread may get one of its own, and keeps what was freed in it."""
LARGE_BYTES = 2**18
"""Arrays from here on are mapped one by one and so given back when freed, instead of up to 32 MB of each heap kept."""
EVERY_S = 10.0
"""Between two times that the heaps give back what was freed in them: it takes 10 to 50 ms where that is 100 MB."""
_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8


def tune_malloc() -> None:
    """Keep little of what is freed, for the whole process and from now on. Elsewhere than with glibc nothing changes.

    Under sixteen robots the server held 1.4 GB and grew without this, and half a gigabyte with it.
    """
    pa.set_memory_pool(pa.system_memory_pool())
    mallopt = _of_glibc("mallopt")
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, ARENAS)
        mallopt(_M_MMAP_THRESHOLD, LARGE_BYTES)


@contextmanager
def periodic_trim(every_s: float = EVERY_S) -> Iterator[None]:
    """Meanwhile whole pages that were freed in the midst of the heaps are given back now and then.

    A heap only shrinks from its end, where something small always lies: without this the process holds for ever the
    most that posts, questions and compaction ever happened to take at once.
    """
    trim = _of_glibc("malloc_trim")
    if trim is None:
        yield
        return
    with Worker("memory", every_s, lambda: trim(0)).running():
        yield


def _of_glibc(name: str) -> Callable[..., Any] | None:
    """A function of the C library, where that is glibc; others can use the interpreter while it runs."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
