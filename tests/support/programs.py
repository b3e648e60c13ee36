"""Programs that some tests run beside the server: installed ones, or those that tests/support/programs.sh fetched."""

import shutil
from pathlib import Path

import pytest

from tests.support.paths import ROOT

FETCHED = [ROOT / ".venv" / "programs" / "usr" / folder for folder in ("bin", "sbin")]


def program(name: str) -> Path:
    """The path of a program; skips the test where there is none."""
    found = shutil.which(name) or shutil.which(name, path=":".join(map(str, FETCHED)))
    if found is None:
        pytest.skip(f"there is no {name} here: run tests/support/programs.sh, or install it")
    return Path(found)
