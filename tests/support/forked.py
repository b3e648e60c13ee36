"""`tidemap …` as a process that starts in a quarter of the time: a fork of one that has imported everything already."""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.support.paths import ROOT

_processes = multiprocessing.get_context("forkserver")
_processes.set_forkserver_preload(["tests.support.preloaded"])


class Forked:
    """A process of its own, with the part of the interface of `subprocess.Popen` that ServerProcess needs."""

    def __init__(self, words: Sequence[str], env: Mapping[str, str], log: Path) -> None:
        self._words = words
        self._process = _processes.Process(target=_run, args=(words, env, log))
        self._process.start()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid or 0

    def poll(self) -> int | None:
        """How it ended, None while it runs."""
        return self._process.exitcode

    def terminate(self) -> None:
        """SIGTERM."""
        self._process.terminate()

    def kill(self) -> None:
        """SIGKILL."""
        self._process.kill()

    def wait(self, timeout: float | None = None) -> int:
        """How it ended. Raises subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self._words, timeout or 0.0)
        return self._process.exitcode


def _run(words: Sequence[str], env: Mapping[str, str], log: Path) -> None:
    from tidemap.cli import main

    os.chdir(ROOT)
    os.environ.clear()
    os.environ.update(env)
    with log.open("ab") as output:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    sys.exit(main(words))
