"""Warm: nobody waits for a kernel that is compiled for them."""

import json
import subprocess
import sys

from tests.support.paths import ROOT


def test_once_warm_nothing_that_a_server_does_compiles_anything(database_url: str) -> None:
    command = [sys.executable, "-m", "tests.support.compiled", database_url]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == []
