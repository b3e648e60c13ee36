"""`tidemap verify` as operators run it."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from tests.support.here import command
from tests.support.server import ServerProcess, StartServer, run_command
from tests.support.waiting import WAIT_S


def fill(server: ServerProcess, posts: int = 3) -> None:
    """A door that was observed some times."""
    with httpx.Client(base_url=f"{server.url}/api/v1", timeout=WAIT_S, trust_env=False) as http:
        assert http.post("/locations", json={"name": "door", "interval_s": 60}).status_code == 201
        for n in range(posts):
            answer = http.post("/locations/door/observations", json={"time": [60 * n], "state": [n % 2]})
            assert answer.status_code == 201


class TestVerify:
    """0 nothing wrong, 1 something wrong, 2 cannot be opened."""

    def test_beside_a_running_server(self, server: StartServer) -> None:
        running = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_UPDATER": "false"})
        fill(running)
        done = run_command("verify", "--data", str(running.data))
        assert done.returncode == 0, done.stderr
        assert done.stderr.splitlines()[0] == "Verifying locations: ..."
        assert done.stdout == "1 locations, 3 blobs, 3 observations: nothing wrong\n"
        running.kill()
        again = command("verify", "--data", str(running.data), "--json")
        assert again.returncode == 0
        assert json.loads(again.stdout) == {"locations": 1, "blobs": 3, "observations": 3, "findings": []}

    def test_damage(self, tmp_path: Path) -> None:
        command("migrate", "--data", str(tmp_path))
        with closing(sqlite3.connect(tmp_path / "tidemap.db")) as database:
            database.execute("INSERT INTO job VALUES (5, 1, 'update', 'queued', 0, '{}', NULL, NULL, 0, NULL)")
            database.commit()
        done = command("verify", "--data", str(tmp_path))
        assert done.returncode == 1
        assert "table job: 1 rows of location 5, which does not exist" in done.stdout
        assert done.stdout.endswith("0 locations, 0 blobs, 0 observations: 2 wrong\n")
        told = json.loads(command("verify", "--data", str(tmp_path), "--json").stdout)
        assert {"location": None, "where": "counter job", "what": "it stands at 0, but 1 is in use"} in told["findings"]

    def test_a_damaged_file(self, tmp_path: Path) -> None:
        """A page of zeros: SQLite says so, and the rest is looked at all the same."""
        command("migrate", "--data", str(tmp_path))
        path = tmp_path / "tidemap.db"
        with closing(sqlite3.connect(path)) as database:
            (page,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'job'").fetchone()
            (size,) = database.execute("PRAGMA page_size").fetchone()
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        content = bytearray(path.read_bytes())
        content[(page - 1) * size : page * size] = bytes(size)
        path.write_bytes(content)
        done = command("verify", "--data", str(tmp_path))
        assert done.returncode == 1
        assert "database" in done.stdout

    def test_nothing_to_open(self, tmp_path: Path) -> None:
        done = command("verify", "--data", str(tmp_path))
        assert (done.returncode, done.stdout) == (2, "")
        assert "There is no database" in done.stderr
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("content", [b"", b"this is a letter, not a database" * 100])
    def test_a_file_that_is_no_database(self, tmp_path: Path, content: bytes) -> None:
        (tmp_path / "tidemap.db").write_bytes(content)
        done = command("verify", "--data", str(tmp_path))
        assert done.returncode == 2
        assert "database" in done.stderr
