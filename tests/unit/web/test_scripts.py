"""The pages' scripts: what their types say is checked, so a wrong call is found before a browser runs it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

WEB = ROOT / "web"
STATIC = Path("tidemap_web", "pages", "static")


@pytest.fixture
def scripts(tmp_path: Path) -> Path:
    """A copy of the scripts and of what they are checked with."""
    for name in ("deno.json", "types.d.ts"):
        shutil.copy(WEB / name, tmp_path)
    shutil.copytree(WEB / STATIC, tmp_path / STATIC, ignore=shutil.ignore_patterns("vendor"))
    return tmp_path


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    deno = Path(sys.executable).with_name("deno")
    files = [folder / "types.d.ts", *sorted((folder / STATIC).rglob("*.js"))]
    command: list[str | Path] = [
        deno,
        "check",
        "--quiet",
        "--no-remote",
        "--no-npm",
        "--config",
        folder / "deno.json",
        *files,
    ]
    environment = os.environ | {"DENO_DIR": str(folder / "cache"), "DENO_NO_UPDATE_CHECK": "1", "NO_COLOR": "1"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_their_types_are_right(scripts: Path) -> None:
    done = check(scripts)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('dayText("now", "UTC");', "'string' is not assignable to parameter of type 'number'"),
        ("const wrong = (value) => value;", "implicitly has an 'any' type"),
        ('document.getElementById("chart").remove();', "possibly 'null'"),
    ],
)
def test_a_wrong_type_is_noticed(scripts: Path, line: str, says: str) -> None:
    with (scripts / STATIC / "core" / "words.js").open("a") as script:
        script.write(line)
    done = check(scripts)
    assert done.returncode == 1
    assert says in done.stderr
