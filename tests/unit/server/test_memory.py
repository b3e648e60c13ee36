"""What the process keeps of memory that it has freed."""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
MANY_THREADS = """
import threading
import numpy as np
from tests.support.memory import memory_mb
from tidemap.server.memory import tune_malloc

tune_malloc()

def work():
    for _ in range(5):
        parts = [np.ones(100_000) for _ in range(50)]

for _ in range(4):
    threads = [threading.Thread(target=work) for _ in range(12)]
    [each.start() for each in threads]
    [each.join() for each in threads]
import os
print(memory_mb(os.getpid()))
"""
BESIDE_SMALL_ONES = """
import os, time
import numpy as np
from tests.support.memory import memory_mb
from tidemap.server.memory import tune_malloc, periodic_trim

tune_malloc()
pairs = [(np.ones(5000), bytes(1000)) for _ in range(3000)]
small = [pair[1] for pair in pairs]
full = memory_mb(os.getpid())
del pairs
with periodic_trim(0.05):
    until = time.monotonic() + 20
    while full - memory_mb(os.getpid()) < 100 and time.monotonic() < until:
        time.sleep(0.05)
print(full - memory_mb(os.getpid()))
"""


def printed_mb(script: str) -> float:
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    return float(done.stdout)


def test_what_threads_freed_is_given_back() -> None:
    assert printed_mb(MANY_THREADS) < 250


def test_arrays_that_lay_between_small_things_are_given_back() -> None:
    """120 MB in blocks of 40 kB, with a kilobyte that stays behind each."""
    assert printed_mb(BESIDE_SMALL_ONES) > 100
