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
EXAMPLES = ROOT / "docs" / "examples"


def test_the_quickstart_predicts_and_notices(shared_server: ServerProcess, tmp_path: Path) -> None:
    printed = _example("quickstart", shared_server, tmp_path)
    probabilities, anomalies = printed.split("\n", 1)
    by_day, by_night = (float(number) for number in re.findall(r"[\d.]+", probabilities))
    assert by_day > 0.9
    assert by_night < 0.1
    assert anomalies.count("location='front-door'") == 1


PRINTS = {
    "door_by_cron": r"1\n",
    "grid_from_numpy": r"crate at ten (0\.[89]\d|1\.00), at night 0\.[01]\d, corner nan\n",
    "offline_robot": r"waiting 5\nsent True refused 0\nstored 5\n",
    "asynchronous": r"(async-door-\d [01]\.\d\d\n){5}",
    "poll_anomalies": r"polled-door at 2430000: observed 1, expected 0\.[01]\d\n",
    "follow_events": r"(\w+ followed-door\n)*update followed-door\n",
}


def test_every_example_is_run_here() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {"quickstart", *PRINTS}


@pytest.mark.parametrize("name", PRINTS)
def test_the_example_prints(shared_server: ServerProcess, tmp_path: Path, name: str) -> None:
    printed = _example(name, shared_server, tmp_path)
    assert re.fullmatch(PRINTS[name], printed), printed


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


def _example(name: str, server: ServerProcess, folder: Path) -> str:
    """What an example prints with this server."""
    example = (EXAMPLES / f"{name}.py").read_text()
    assert ADDRESS in example
    script = folder / f"{name}.py"
    script.write_text(example.replace(ADDRESS, server.url))
    return _run([sys.executable, "-W", "error", str(script)])


def _run(command: list[str]) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env=clean_environment(), cwd=ROOT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
