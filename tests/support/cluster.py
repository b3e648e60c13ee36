"""A Dask cluster of real processes: a scheduler, and workers that `tidemap worker` starts."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.support.forked import Forked
from tests.support.server import clean_environment
from tests.support.waiting import until

JOINED = "this process runs tasks of the Dask cluster"


class Cluster:
    """A scheduler on a free port of the loopback address, with its files in `folder`."""

    def __init__(self, folder: Path, scheduler_env: Mapping[str, str] | None = None) -> None:
        self._folder = folder
        self._scheduler_env = dict(scheduler_env or {})
        self._file = folder / "scheduler.json"
        self._stack = ExitStack()
        self._n_workers = 0
        self._port = 0
        self.start_scheduler()

    def start_scheduler(self) -> None:
        """Start it, after `stop_scheduler` at the port of before."""
        self._file.unlink(missing_ok=True)
        words = ["--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard", "--no-show"]
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", *words, "--scheduler-file", str(self._file)]
        env = clean_environment() | self._scheduler_env
        with (self._folder / "scheduler.log").open("ab") as log:
            self._scheduler = subprocess.Popen(command, cwd=self._folder, env=env, stdout=log, stderr=log)
        until(lambda: self._scheduler.poll() is not None or self._written())
        assert self._scheduler.poll() is None, _text(self._folder / "scheduler.log")
        self.address: str = json.loads(self._file.read_text())["address"]
        self._port = int(self.address.rpartition(":")[2])

    def stop_scheduler(self) -> None:
        """End it as a power cut would."""
        self._scheduler.kill()
        self._scheduler.wait()

    def freeze_scheduler(self) -> None:
        """Have it keep its connections, and be silent."""
        self._scheduler.send_signal(signal.SIGSTOP)

    @property
    def env(self) -> dict[str, str]:
        """What a process of this cluster has in its environment."""
        return {"TIDEMAP_DASK_SCHEDULER": self.address}

    @property
    def pid(self) -> int:
        """The scheduler's."""
        return self._scheduler.pid

    def worker(self, database_url: str, env: Mapping[str, str] | None = None) -> Forked:
        """Start a worker, and wait until it has joined."""
        self._n_workers += 1
        log = self._folder / f"worker-{self._n_workers}.log"
        words = ["worker", "--database-url", database_url]
        process = Forked(words, clean_environment() | self.env | dict(env or {}), log)
        self._stack.callback(_end, process)
        until(lambda: process.poll() is not None or JOINED in _text(log))
        assert process.poll() is None, _text(log)
        return process

    def close(self) -> None:
        """End all of it."""
        self._stack.close()
        self.stop_scheduler()

    def _written(self) -> bool:
        try:
            return "address" in json.loads(self._file.read_text())
        except (FileNotFoundError, ValueError):
            return False


@contextmanager
def running_cluster(folder: Path, scheduler_env: Mapping[str, str] | None = None) -> Iterator[Cluster]:
    """A cluster without workers yet, gone afterwards."""
    cluster = Cluster(folder, scheduler_env)
    try:
        yield cluster
    finally:
        cluster.close()


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""


def _end(process: Forked) -> None:
    if process.poll() is None:
        process.terminate()
        process.wait()
