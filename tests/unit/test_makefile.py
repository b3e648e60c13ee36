"""The Makefile in a folder of its own, whose name holds a space: what it says before it installs anything."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.paths import ROOT

OLD_PYTHON = """#!/bin/sh
case "$2" in
    *sys.exit*) exit 1 ;;
    *) echo "Python 3.9.2" ;;
esac
"""
# A Python that is new enough, and a venv made by copying itself: no network, no real installation.
FAKE_PYTHON = """#!/bin/sh
echo "$*" >> calls
if [ "$2" = venv ]; then mkdir -p .venv/bin && cp "$0" .venv/bin/python; fi
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of what `make setup` reads."""
    made = tmp_path / "a folder"
    made.mkdir()
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, made)
    return made


def make(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """`make` as a person calls it, not as a child of the `make test` that runs this."""
    env = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(["make", *arguments], cwd=folder, env=env, capture_output=True, text=True, check=False)


def script(folder: Path, text: str) -> str:
    """An executable script of this text; its name."""
    path = folder / "some python"
    path.write_text(text)
    path.chmod(0o755)
    return f"PYTHON=./{path.name}"


def calls(folder: Path) -> list[str]:
    """How the fake Python was called, the probes of the Makefile left out."""
    return [call for call in (folder / "calls").read_text().splitlines() if not call.startswith("-c")]


def test_help_explains_every_target(folder: Path) -> None:
    shown = make(folder)
    assert shown.returncode == 0
    for target in ("setup", "run", "test", "check", "bench", "screenshots", "dist", "clean"):
        assert re.search(rf"^  make {target} +\S", shown.stdout, re.MULTILINE), target


def test_a_python_that_is_too_old_is_named(folder: Path) -> None:
    refused = make(folder, "run", script(folder, OLD_PYTHON))
    assert refused.returncode != 0
    assert "needs Python 3.11 or newer; './some python' is Python 3.9.2." in refused.stderr
    assert "make run PYTHON=python3.12" in refused.stderr


def test_a_python_that_is_none_is_named(folder: Path) -> None:
    refused = make(folder, "setup", "PYTHON=python-of-nobody")
    assert "'python-of-nobody' is no Python that runs." in refused.stderr


def test_setup_installs_once_and_again_when_what_it_reads_changed(folder: Path) -> None:
    python = script(folder, FAKE_PYTHON)
    installed = [
        "-m venv .venv",
        "-m pip install -qq --disable-pip-version-check -c constraints.txt -e .[server,dev]",
    ]

    assert make(folder, "setup", python).returncode == 0
    assert calls(folder) == installed

    assert "Nothing to be done" in make(folder, "setup", python).stdout
    assert calls(folder) == installed

    os.utime(folder / "constraints.txt")
    assert make(folder, "setup", python).returncode == 0
    assert calls(folder) == installed * 2


def test_a_moved_folder_is_set_up_anew(folder: Path) -> None:
    python = script(folder, FAKE_PYTHON)
    make(folder, "setup", python)
    marker = folder / ".venv" / "of the old place"
    marker.touch()
    moved = folder.rename(folder.with_name("another folder"))
    make(moved, "setup", python)
    assert (moved / ".venv" / "folder").read_text().strip() == str(moved)
    assert not (moved / ".venv" / marker.name).exists()


def test_run_passes_host_port_and_data_on(folder: Path) -> None:
    assert make(folder, "run", script(folder, FAKE_PYTHON), "PORT=8123", "DATA=some where").returncode == 0
    assert calls(folder)[-1] == "-m tidemap.cli serve --host 127.0.0.1 --port 8123 --data some where --demo"


def test_ci_runs_what_people_run() -> None:
    run = ROOT / ".ci" / "run"
    assert os.access(run, os.X_OK)
    assert run.read_text().splitlines()[-1] == "exec make test"
