"""`tidemap backup` beside servers that are written to, and what can be done with its copies."""

import shlex
import subprocess
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest

from tests.support.databases import PostgresDatabases
from tests.support.here import command
from tests.support.postgres import Postgres
from tests.support.server import ServerProcess, StartServer, run_command

CLIENTS = 8
POSTS_BEFORE = 200
ODD = "file:ünd 100%41? #&=+@;☃"
"""What each of the ways to write down a file, as a path, a URL and SQLite's own URI, takes to mean something else."""
QUIET = {"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER_INTERVAL_S": "0.1", "TIDEMAP_UPDATE_REST_S": "0"}


class Posting:
    """Clients that post as fast as they can; `acknowledged` are the times of what was answered 201."""

    def __init__(self, server: ServerProcess) -> None:
        self._url = f"{server.url}/api/v1"
        self.acknowledged: list[int] = []
        self.enough, self.more, self._stop = threading.Event(), threading.Event(), threading.Event()

    def run(self, client: int) -> None:
        with httpx.Client(base_url=self._url, timeout=60, trust_env=False) as http:
            number = 0
            while not self._stop.is_set():
                time = number * CLIENTS + client
                form = {"time": [time], "state": [number % 2]}
                answer = http.post("/locations/door/observations", json=form, headers={"Idempotency-Key": str(time)})
                assert answer.status_code == 201, answer.text
                self.acknowledged.append(time)
                number += 1
                if len(self.acknowledged) >= POSTS_BEFORE:
                    self.enough.set()

    @contextmanager
    def going_on(self) -> Iterator[None]:
        with ThreadPoolExecutor(CLIENTS) as pool:
            running = [pool.submit(self.run, client) for client in range(CLIENTS)]
            try:
                assert self.enough.wait(120)
                yield
            finally:
                self._stop.set()
            for each in running:
                each.result()


def names(folder: Path) -> list[str]:
    """What is in a folder, hidden files too."""
    return sorted(path.name for path in folder.iterdir())


def make_door(server: ServerProcess) -> None:
    form = {"name": "door", "interval_s": 1, "estimator": "static"}
    assert httpx.post(f"{server.url}/api/v1/locations", json=form, trust_env=False).status_code == 201


def test_a_copy_from_the_midst_of_posting_is_whole(server: StartServer, tmp_path: Path) -> None:
    running = server(env=QUIET)
    make_door(running)
    copy = tmp_path / "restored" / "tidemap.db"
    copy.parent.mkdir()
    posting = Posting(running)
    with posting.going_on():
        acknowledged = list(posting.acknowledged)
        done = run_command("backup", str(copy), "--data", str(running.data))
        during = len(posting.acknowledged) - len(acknowledged)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[0] == "Copying pages: ..."
    assert str(copy) in done.stdout
    assert during > 0
    assert names(copy.parent) == ["tidemap.db"]
    checked = run_command("verify", "--data", str(copy.parent))
    assert checked.returncode == 0, checked.stdout
    assert "1 locations" in checked.stdout
    restored = server("--data", str(copy.parent), env=QUIET)
    with httpx.Client(base_url=f"{restored.url}/api/v1", timeout=60, trust_env=False) as http:
        total = http.get("/locations/door").json()["observations"]
        assert len(acknowledged) <= total <= len(posting.acknowledged)
        last = max(acknowledged) + 1
        observed = http.get("/locations/door/series", params={"start": 0, "stop": last}).json()["observed"]
        assert all(observed[time] == time // CLIENTS % 2 for time in acknowledged)
        form = {"time": [acknowledged[-1]], "state": [acknowledged[-1] // CLIENTS % 2]}
        key = {"Idempotency-Key": str(acknowledged[-1])}
        again = http.post("/locations/door/observations", json=form, headers=key)
        assert (again.status_code, again.json()["duplicate"]) == (200, True)


def make_database(folder: Path) -> None:
    """With a robot's key."""
    for words in (("migrate",), ("keys", "create", "--role", "robot")):
        assert command(*words, "--data", str(folder)).returncode == 0


class TestFile:
    """Where the copy goes, and what happens to what was there."""

    @pytest.fixture
    def data(self, tmp_path: Path) -> Path:
        folder = tmp_path / "data"
        make_database(folder)
        return folder

    def test_what_is_there_stays_unless_told_otherwise(self, data: Path, tmp_path: Path) -> None:
        file = tmp_path / "copy.db"
        file.write_text("mine")
        refused = command("backup", str(file), "--data", str(data))
        assert refused.returncode == 1
        assert "--overwrite" in refused.stderr
        assert file.read_text() == "mine"
        assert command("backup", str(file), "--overwrite", "--data", str(data)).returncode == 0
        listed = command("keys", "list", "--database-url", f"sqlite:///{file}")
        assert "robot" in listed.stdout

    def test_it_is_as_private_as_the_database(self, data: Path, tmp_path: Path) -> None:
        (data / "tidemap.db").chmod(0o600)
        file = tmp_path / "copy.db"
        assert command("backup", str(file), "--data", str(data)).returncode == 0
        assert file.stat().st_mode & 0o777 == 0o600

    def test_a_failure_leaves_nothing(self, data: Path, tmp_path: Path) -> None:
        target = tmp_path / "target"
        target.mkdir()
        (target / "folder").mkdir()
        for file in (target / "none" / "copy.db", target / "folder"):
            done = command("backup", str(file), "--overwrite", "--data", str(data))
            assert done.returncode == 1, done.stdout
        assert [path.name for path in target.rglob("*")] == ["folder"]

    def test_there_must_be_a_database(self, tmp_path: Path) -> None:
        done = command("backup", str(tmp_path / "copy.db"), "--data", str(tmp_path / "none"))
        assert done.returncode == 1
        assert "database" in done.stderr
        (tmp_path / "tidemap.db").write_bytes(b"")
        done = command("backup", str(tmp_path / "copy.db"), "--data", str(tmp_path))
        assert done.returncode == 1
        assert "no Tidemap database" in done.stderr
        assert names(tmp_path) == ["tidemap.db"]

    def test_a_folder_with_any_name(self, tmp_path: Path) -> None:
        folder = tmp_path / ODD
        make_database(folder)
        for words in (("backup", str(folder / f"{ODD}.db")), ("verify",), ("keys", "list")):
            done = command(*words, "--data", str(folder))
            assert done.returncode == 0, done.stderr
        assert "robot" in done.stdout
        assert [path.name for path in tmp_path.iterdir()] == [ODD]
        copied = command("keys", "list", "--database-url", f"sqlite:///{quote(str(folder / f'{ODD}.db'))}")
        assert "robot" in copied.stdout


def test_a_server_works_in_a_folder_with_any_name(server: StartServer, tmp_path: Path) -> None:
    folder = tmp_path / ODD
    running = server("--data", str(folder), env=QUIET)
    make_door(running)
    assert command("backup", str(folder / "copy.db"), "--data", str(folder)).returncode == 0
    running.stop()
    assert [path.name for path in tmp_path.iterdir()] == [ODD]
    assert (
        {"tidemap.db", "copy.db"} <= set(names(folder)) <= {"tidemap.db", "tidemap.db-wal", "tidemap.db-shm", "copy.db"}
    )


class TestPostgres:
    """The command prints the line that makes a backup, and that line works."""

    def test_the_password_stays_secret(self, tmp_path: Path) -> None:
        url = "postgresql+psycopg://me:sesame@db.example:5433/tidemap"
        done = command("backup", str(tmp_path / "my copy"), "--database-url", url)
        assert (done.returncode, done.stdout) == (2, "")
        assert "sesame" not in done.stderr
        line = done.stderr.splitlines()[-1]
        assert shlex.split(line) == [
            "pg_dump",
            "--format=custom",
            f"--file={tmp_path / 'my copy'}",
            "--dbname=postgresql://me@db.example:5433/tidemap",
        ]

    def test_a_copy_from_the_midst_of_posting_is_whole(
        self, server: StartServer, postgres: Postgres, tmp_path: Path
    ) -> None:
        databases = PostgresDatabases(postgres)
        file = tmp_path / "copy"
        with databases.migrated() as url, databases.empty() as restored:
            running = server(database_url=url, env=QUIET)
            make_door(running)
            line = shlex.split(command("backup", str(file), "--database-url", url).stderr.splitlines()[-1])
            posting = Posting(running)
            with posting.going_on():
                acknowledged = len(posting.acknowledged)
                run_program(postgres, line)
            running.stop()
            target = restored.replace("postgresql+psycopg", "postgresql")
            run_program(postgres, ["pg_restore", "--exit-on-error", f"--dbname={target}", str(file)])
            checked = command("verify", "--database-url", restored)
            assert checked.returncode == 0, checked.stdout
            again = server(database_url=restored, env=QUIET)
            answer = httpx.get(f"{again.url}/api/v1/locations/door", trust_env=False)
            assert acknowledged <= answer.json()["observations"] <= len(posting.acknowledged)
            again.stop()


def run_program(postgres: Postgres, line: list[str]) -> None:
    """One of PostgreSQL's own programs."""
    done = subprocess.run([postgres.programs / line[0], *line[1:]], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
