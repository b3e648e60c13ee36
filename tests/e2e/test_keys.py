"""Keys, as people make and use them."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.support.contexts import opened
from tests.support.here import command
from tests.support.paths import ROOT
from tests.support.server import ServerProcess, StartServer, clean_environment
from tests.support.server_sent import event_source
from tests.support.waiting import WAIT_S
from tidemap.services.audit import list_entries


def make_key(where: tuple[str, ...], role: str, *more: str) -> dict[str, Any]:
    done = command("keys", "create", "--role", role, *where, "--json", *more)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def get(server: ServerProcess, path: str, secret: str | None = None) -> int:
    headers = bearer(secret) if secret else {}
    return httpx.get(f"{server.url}{path}", headers=headers, trust_env=False).status_code


def test_keys_are_made_listed_and_revoked_while_the_server_runs(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    where = ("--data", str(running.data))
    assert get(running, "/api/v1/locations") == 200, "open on loopback while there is no key"

    admin = make_key(where, "admin", "--name", "the boss")
    robot = make_key(where, "robot")
    assert (admin["name"], admin["role"], robot["name"]) == ("the boss", "admin", "robot")
    assert get(running, "/api/v1/locations") == 401, "closed from the first key on"
    assert get(running, "/api/v1/locations", admin["key"]) == 200
    assert get(running, "/api/v1/locations", robot["key"]) == 403
    assert get(running, "/healthz") == get(running, "/readyz") == 200

    listed = json.loads(command("keys", "list", *where, "--json").stdout)
    assert [(key["name"], key["role"]) for key in listed] == [("the boss", "admin"), ("robot", "robot")]
    plain = command("keys", "list", *where).stdout
    assert "the boss" in plain
    assert admin["key"] not in plain + json.dumps(listed)

    assert command("keys", "revoke", str(robot["id"]), *where).returncode == 0
    assert get(running, "/api/v1/locations", robot["key"]) == 401
    again = command("keys", "revoke", str(robot["id"]), *where)
    assert again.returncode == 1
    assert "no key" in again.stderr

    running.stop()
    files = b"".join(path.read_bytes() for path in running.data.iterdir())
    assert b"the boss" in files
    for made in (admin, robot):
        assert made["key"].encode() not in files
        assert made["key"][8:].encode() not in files
    assert admin["key"] not in running.output()


def test_keys_on_postgresql(server: StartServer, postgres: Any) -> None:
    url = postgres.url(postgres.create())
    empty = command("keys", "create", "--role", "admin", "--database-url", url)
    assert (empty.returncode, empty.stdout) == (1, "")
    assert "tidemap migrate" in empty.stderr
    assert command("migrate", "--database-url", url).returncode == 0
    made = make_key(("--database-url", url), "admin")
    running = server(database_url=url, env={"TIDEMAP_VIEWER": "false"})
    assert get(running, "/api/v1/locations") == 401
    assert get(running, "/api/v1/locations", made["key"]) == 200


class TestBeyondLoopback:
    """The server listens to others only with keys, or where it is told that somebody else checks them."""

    def test_told_to_be_open_it_is(self, tmp_path: Path) -> None:
        with Serving("--host", "0.0.0.0", "--open", "--data", str(tmp_path)) as url:
            assert httpx.get(f"{url}/api/v1/locations", trust_env=False).status_code == 200

    def test_with_a_key_it_listens_and_stays_closed(self, tmp_path: Path) -> None:
        where = ("--data", str(tmp_path))
        assert command("migrate", *where).returncode == 0
        key = make_key(where, "admin")
        with Serving("--host", "0.0.0.0", *where) as url:

            def ask(**how: Any) -> int:
                return httpx.get(f"{url}/api/v1/locations", trust_env=False, **how).status_code

            assert ask() == 401
            assert ask(headers=bearer(key["key"])) == 200
            removed = httpx.delete(f"{url}/api/v1/keys/{key['id']}", headers=bearer(key["key"]), trust_env=False)
            assert removed.status_code == 204
            assert ask() == 401, "revoking the last key must not let everybody in"


class Serving:
    """A server on another address than the usual one, as a context with its URL."""

    def __init__(self, *options: str) -> None:
        environment = clean_environment() | {"TIDEMAP_VIEWER": "false"}
        words = [sys.executable, "-m", "tidemap.cli", "serve", "--port", "0", *options]
        self._process = subprocess.Popen(words, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert "ready at http://" in line, line
        return line.split()[-1]

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        assert self._process.stdout is not None
        self._process.stdout.close()
        assert self._process.wait(WAIT_S) == 0


def test_keys_that_are_limited_rotated_and_noted(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    where = ("--data", str(running.data))
    admin = make_key(where, "admin")
    limited = make_key(
        where, "operator", "--location", "hall", "--location", "yard-*", "--expires", "2100-01-01T00:00Z"
    )
    assert limited["locations"] == ["hall", "yard-*"]
    assert limited["expires_at"] == "2100-01-01T00:00:00Z"
    new = json.loads(command("keys", "rotate", str(limited["id"]), *where, "--overlap", "0", "--json").stdout)
    assert get(running, "/api/v1/locations", limited["key"]) == 401
    assert get(running, "/api/v1/locations", new["key"]) == 200
    assert get(running, "/api/v1/locations/door", new["key"]) == 403
    assert "hall yard-* until 2100-01-01T00:00:00Z" in command("keys", "list", *where).stdout
    for *wrong, status in (("--location", "*", 2), ("--location", "a b", 2), ("--expires", "1999-01-01T00:00Z", 1)):
        done = command("keys", "create", "--role", "robot", *where, *wrong)
        assert (done.returncode, done.stdout) == (status, "")
        assert "Traceback" not in done.stderr
    for overlap, status, said in (
        ("nan", 2, "no number of seconds"),
        ("inf", 2, "no number of seconds"),
        ("-1", 2, "no number of seconds"),
        ("1e9", 1, "overlap_s: give 0 to"),
    ):
        done = command("keys", "rotate", str(new["id"]), *where, "--overlap", overlap)
        assert (done.returncode, done.stdout) == (status, "")
        assert said in done.stderr
    headers = bearer(admin["key"])
    entries = httpx.get(f"{running.url}/api/v1/audit", headers=headers, trust_env=False).json()["items"]
    assert [each["action"] for each in entries] == ["tidemap keys rotate", *["tidemap keys create"] * 2]
    assert all(each["actor"].endswith("on the command line") for each in entries)
    assert [each["target"] for each in entries] == [str(limited["id"]), "operator", "admin"]
    assert json.loads(entries[0]["detail"]) == {"overlap_s": 0}
    created = json.loads(entries[1]["detail"])
    assert (created["name"], created["role"], created["locations"]) == ("operator", "operator", ["hall", "yard-*"])
    for made in (admin, limited, new):
        assert made["key"] not in json.dumps(entries)


def test_a_user_without_a_name_makes_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container that runs as any number: neither the environment nor the list of users names it."""
    where = ("--data", str(tmp_path))
    assert command("migrate", *where).returncode == 0

    def nobody(uid: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {uid}")

    monkeypatch.setattr("pwd.getpwuid", nobody)
    nameless = dict.fromkeys(("LOGNAME", "USER", "LNAME", "USERNAME"), "")
    made = command("keys", "create", "--role", "admin", *where, env=nameless)
    assert made.returncode == 0, made.stderr
    with opened(f"sqlite:///{tmp_path / 'tidemap.db'}") as ctx:
        (entry,) = list_entries(ctx, None, 10)
    assert entry.actor == f"uid {os.getuid()} on the command line"


def test_streams_and_sockets_end_when_their_key_expires(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    where = ("--data", str(running.data))
    key = make_key(where, "operator")
    headers = bearer(key["key"])
    address = f"ws://127.0.0.1:{running.port}/api/v1/events"
    with (
        event_source(running.url, headers=headers) as source,
        connect(address, additional_headers=headers, proxy=None) as socket,
    ):
        # With an overlap both go on; then the key ends.
        assert command("keys", "rotate", str(key["id"]), *where, "--overlap", "3").returncode == 0
        assert list(source) == []
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=WAIT_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4401
