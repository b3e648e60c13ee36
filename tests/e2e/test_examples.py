"""The examples that the documentation shows are run against a real server."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.documents import blocks
from tests.support.paths import ROOT
from tests.support.server import ServerProcess, clean_environment

ADDRESS = "http://127.0.0.1:8000"


def test_the_quickstart_predicts_and_notices(shared_server: ServerProcess, tmp_path: Path) -> None:
    example = (ROOT / "docs" / "examples" / "quickstart.py").read_text()
    assert example.count(ADDRESS) == 1
    script = tmp_path / "quickstart.py"
    script.write_text(example.replace(ADDRESS, shared_server.url))
    printed = _run([sys.executable, "-W", "error", str(script)])

    probabilities, anomalies = printed.split("\n", 1)
    by_day, by_night = (float(number) for number in re.findall(r"[\d.]+", probabilities))
    assert by_day > 0.9
    assert by_night < 0.1
    assert anomalies.count("location='front-door'") == 1


@pytest.mark.skipif(shutil.which("curl") is None, reason="no curl on this machine")
def test_the_curl_lines_post_and_ask(shared_server: ServerProcess) -> None:
    (shown,) = (block for block in blocks(ROOT / "README.md", "sh") if "curl" in block)
    assert shown.count(ADDRESS) == 1
    # A line for each answer, so that they can be told apart.
    commands = shown.replace(ADDRESS, shared_server.url).replace("curl -sS", "echo; curl -sS --fail-with-body")
    printed = _run(["bash", "-eu", "-c", commands])
    created, accepted, job, state, anomalies = (json.loads(line) for line in printed.split("\n") if line)
    assert created["name"] == "kitchen"
    assert (accepted["accepted"], accepted["duplicate"]) == (4, False)
    assert job["state"] == "done"
    assert state["probability"] == pytest.approx([0.5], abs=0.2)
    assert {"items", "next"} <= set(anomalies)


def _run(command: list[str]) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env=clean_environment(), cwd=ROOT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
