"""The version before the newest migration, from git: its files in a folder, and servers that run them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.server import Process

MIGRATIONS = ROOT / "alembic" / "versions"
NEEDED = ("app", "web", "alembic", "pyproject.toml")
RUN = """
import sys
from tidemap.server import warming

warming.warm_up = lambda: None
from tidemap.cli import main

sys.exit(main(sys.argv[1:]))
"""
"""A server that compiles only what it is asked for; all of it would take a minute on a machine that never ran it."""


def commit_before() -> str | None:
    """The commit before the newest migration; None where git does not know, as in a copy without its history."""
    newest = max(MIGRATIONS.glob("[0-9]*.py"))
    added = _git("log", "-1", "--diff-filter=A", "--format=%H", "--", str(newest))
    return _git("rev-parse", "--verify", "--quiet", f"{added}^") if added else None


def unpack(commit: str, folder: Path) -> None:
    """Put the files of a commit into a folder. Modules that are the same today take along what is compiled of them."""
    packed = subprocess.run(["git", "archive", commit, *NEEDED], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", folder], input=packed.stdout, check=True)
    for before in folder.rglob("*.py"):
        today = ROOT / before.relative_to(folder)
        if today.is_file() and today.read_bytes() == before.read_bytes():
            # What is compiled fits a source of the same time.
            shutil.copystat(today, before)
            compiled = before.parent / "__pycache__"
            compiled.mkdir(exist_ok=True)
            for each in (today.parent / "__pycache__").glob(f"{today.stem}.*.nb?"):
                shutil.copy2(each, compiled)


class ReleaseBefore:
    """Launches servers of the files in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, words: Sequence[str], env: Mapping[str, str], log: Path) -> Process:
        paths = os.pathsep.join(str(self._folder / root) for root in ("app", "web"))
        with log.open("ab") as output:
            return subprocess.Popen(
                [sys.executable, "-c", RUN, *words],
                cwd=self._folder,
                env={**env, "PYTHONPATH": paths},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )


def _git(*words: str) -> str | None:
    """What git says; None where it fails or is not there."""
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
