"""The server as people run it: a process of its own, reached over HTTP."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import httpx

from tests.support.forked import Forked
from tests.support.paths import ROOT
from tests.support.waiting import WAIT_S

# The first start on a machine compiles the numeric kernels.
READY_S = 120.0
STOP_S = 30.0
_ANNOUNCED = re.compile(r"Tidemap is ready at (http://\S+)")


Process = subprocess.Popen[bytes] | Forked
Launch = Callable[[Sequence[str], Mapping[str, str], Path], Process]
"""Starts `tidemap …` with an environment, its output appended to a file: `fresh`, or `Forked` for many starts."""


def fresh(words: Sequence[str], env: Mapping[str, str], log: Path) -> Process:
    """As people start it, with a fresh Python."""
    with log.open("ab") as output:
        return subprocess.Popen(
            [sys.executable, "-m", "tidemap.cli", *words],
            cwd=ROOT,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )


class ServerProcess:
    """One `tidemap serve` on a free port of the loopback address, its output in `log`."""

    running: ClassVar["set[ServerProcess]"] = set()

    def __init__(
        self,
        folder: Path,
        *options: str,
        database_url: str | None = None,
        env: Mapping[str, str] | None = None,
        ready_s: float = READY_S,
        launch: Launch = fresh,
    ) -> None:
        self.data = folder / "data"
        self.log = folder / "server.log"
        self.url = ""
        self._options = options
        self._where = ("--database-url", database_url) if database_url else ("--data", str(self.data))
        self._env = clean_environment() | dict(env or {})
        self._ready_s = ready_s
        self._launch = launch
        self.process = self._start(port=0)

    @property
    def port(self) -> int:
        """The port it listens on."""
        return httpx.URL(self.url).port or 80

    def stop(self) -> int:
        """End it as an operator would, with SIGTERM; its exit status."""
        self.process.terminate()
        return self._ended()

    def kill(self) -> None:
        """End it as a power cut would, with SIGKILL."""
        self.process.kill()
        self._ended()

    def restart(self) -> None:
        """Start it again, on the same data and port; stop it first if it runs."""
        if self.process.poll() is None:
            self.stop()
        self.process = self._start(self.port)

    def output(self, lines: int | None = None) -> str:
        """What it printed since its first start, or only the last lines."""
        text = self.log.read_text(errors="replace") if self.log.exists() else ""
        return text if lines is None else "\n".join(text.splitlines()[-lines:])

    def _start(self, port: int) -> Process:
        printed_before = len(self.output())
        words = ["serve", "--host", "127.0.0.1", "--port", str(port), *self._where, *self._options]
        process = self._launch(words, self._env, self.log)
        self.running.add(self)
        try:
            self.url = self._announced(process, printed_before)
        except BaseException:
            process.kill()
            process.wait()
            self.running.discard(self)
            raise
        return process

    def _announced(self, process: Process, printed_before: int) -> str:
        """Wait until it says where it is ready, and hold it to that."""
        deadline = time.monotonic() + self._ready_s
        while not (found := _ANNOUNCED.search(self.output(), printed_before)):
            if (status := process.poll()) is not None:
                raise ServerFailedError(f"The server ended with {status}:\n{self.output(60)}")
            if time.monotonic() > deadline:
                raise ServerFailedError(f"The server was not ready in {self._ready_s:.0f} s:\n{self.output(60)}")
            time.sleep(0.02)
        url = found[1].rstrip("/")
        answer = httpx.get(f"{url}/readyz", trust_env=False, timeout=WAIT_S)
        if answer.status_code != 200:
            raise ServerFailedError(f"/readyz answered {answer.status_code} after 'ready':\n{self.output(60)}")
        return url

    def _ended(self) -> int:
        try:
            status = self.process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise ServerFailedError(f"The server did not end in {STOP_S:.0f} s:\n{self.output(60)}") from None
        finally:
            self.running.discard(self)
        return status


StartServer = Callable[..., ServerProcess]
"""Starts a server with the options and keywords of ServerProcess; the fixture `server`."""


class ServerFailedError(AssertionError):
    """The server did not start or stop as it should; the message holds the end of its log."""


def clean_environment() -> dict[str, str]:
    """This process's environment without the caller's own Tidemap settings; posts may be of any time."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("TIDEMAP_")}
    return kept | {"PYTHONUNBUFFERED": "1", "TIDEMAP_PAST_S": "1e11"}


def run_command(
    *arguments: str,
    env: Mapping[str, str] | None = None,
    input_text: str | None = None,
    timeout_s: float = 120,
) -> "subprocess.CompletedProcess[str]":
    """Run `tidemap …` to its end and return its status and output."""
    return subprocess.run(
        [sys.executable, "-m", "tidemap.cli", *arguments],
        cwd=ROOT,
        env=clean_environment() | dict(env or {}),
        input=input_text,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout_s,
    )
