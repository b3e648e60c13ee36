"""What the process keeps of memory that it has freed."""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT

SCRIPT = """
import threading
import numpy as np
from tests.support.memory import memory_mb
from web.memory import give_back_freed

give_back_freed()

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


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_what_threads_freed_is_given_back() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=ROOT, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 250
