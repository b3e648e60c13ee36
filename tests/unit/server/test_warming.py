"""Warming: a server compiles nothing in its own process, not even on its first start."""

import os
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

WARM_UP = """
from numba.core.event import install_recorder
from tidemap.server.warming import warm_up

with install_recorder("numba:compile") as recorder:
    warm_up()
print(sum(event.is_start for _, event in recorder.buffer))
"""


def test_a_first_start_compiles_in_another_process(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", WARM_UP]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert any(tmp_path.rglob("*.nbi"))
    assert done.stdout.split() == ["1"], "only the kernel that was refused at first"
