"""A socket ends with the key or session that opened it, in every process."""

import subprocess
import sys

import httpx
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from tests.e2e.test_keys import make_key
from tests.support.databases import PostgresDatabases
from tests.support.here import command
from tests.support.paths import ROOT
from tests.support.postgres import Postgres
from tests.support.server import StartServer, clean_environment
from tests.support.waiting import until
from tidemap.api.auth import RECHECK_S

PATHS = ["/api/v1/events", "/view/control/0123456789abcdef"]
WAIT_S = 30.0


def test_sockets_close_when_a_key_is_revoked_or_its_browser_signs_out(server: StartServer) -> None:
    assert RECHECK_S <= 4
    running = server()
    where = ("--data", str(running.data))
    key = make_key(where, "operator")
    with httpx.Client(base_url=running.url, trust_env=False) as browser:
        assert browser.post("/login", data={"key": key["key"]}).status_code == 303
        cookie = f"tidemap_session={browser.cookies['tidemap_session']}"
        for path in PATHS:
            with connect(_ws(running.url + path), additional_headers={"Cookie": cookie}, proxy=None) as socket:
                assert browser.get("/").status_code == 200
                browser.post("/logout", headers={"Cookie": cookie})
                assert _close_code(socket) == 4401
            browser.cookies.clear()
            browser.post("/login", data={"key": key["key"]})
            cookie = f"tidemap_session={browser.cookies['tidemap_session']}"
    bearer = {"Authorization": f"Bearer {key['key']}"}
    sockets = [connect(_ws(running.url + path), additional_headers=bearer, proxy=None) for path in PATHS]
    assert command("keys", "revoke", str(key["id"]), *where).returncode == 0
    for socket in sockets:
        assert _close_code(socket) == 4401


def test_the_scene_ends_with_the_key_of_its_tab(server: StartServer) -> None:
    running = server()
    key = make_key(("--data", str(running.data)), "operator")
    bearer = {"Authorization": f"Bearer {key['key']}"}
    tab = connect(_ws(running.url + PATHS[1]), additional_headers=bearer, proxy=None)
    until(lambda: httpx.get(f"{running.url}/view/sessions", headers=bearer, trust_env=False).json())
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    address = _ws(running.url + PATHS[1].replace("control", "scene"))
    scene = connect(address, additional_headers=bearer, subprotocols=spoken, max_size=None, proxy=None)
    assert scene.recv(timeout=WAIT_S)
    assert command("keys", "revoke", str(key["id"]), "--data", str(running.data)).returncode == 0
    assert _close_code(scene) in (4401, 1001)  # the tab may have ended first
    assert _close_code(tab) == 4401


def test_sockets_end_with_a_key_that_another_process_revokes(server: StartServer, database_url: str) -> None:
    where = ("--database-url", database_url)
    key, admin = make_key(where, "operator"), make_key(where, "admin")
    running = server(database_url=database_url, env={"TIDEMAP_VIEWER": "false"})
    with httpx.Client(base_url=running.url, trust_env=False) as browser:
        browser.post("/login", data={"key": key["key"]})
        cookie = {"Cookie": f"tidemap_session={browser.cookies['tidemap_session']}"}
    senders = [cookie, {"Authorization": f"Bearer {key['key']}"}]
    address = _ws(running.url + PATHS[0])
    sockets = [connect(address, additional_headers=headers, proxy=None) for headers in senders]
    revoke = [sys.executable, "-m", "tidemap.cli", "keys", "revoke", str(key["id"]), *where]
    subprocess.run(revoke, cwd=ROOT, env=clean_environment(), check=True, capture_output=True)
    assert [_close_code(socket) for socket in sockets] == [4401, 4401]
    for headers in senders:
        assert httpx.get(f"{running.url}/api/v1/locations", headers=headers, trust_env=False).status_code == 401
    right = {"Authorization": f"Bearer {admin['key']}"}
    assert httpx.get(f"{running.url}/api/v1/keys", headers=right, trust_env=False).status_code == 200


def test_sockets_end_with_a_session_that_is_signed_out_in_another_process(
    server: StartServer, postgres: Postgres
) -> None:
    with PostgresDatabases(postgres).migrated() as url:
        key = make_key(("--database-url", url), "operator")
        one, other = (server(database_url=url, env={"TIDEMAP_VIEWER": "false"}) for _ in range(2))
        with httpx.Client(base_url=one.url, trust_env=False) as browser:
            assert browser.post("/login", data={"key": key["key"]}).status_code == 303
            cookie = {"Cookie": f"tidemap_session={browser.cookies['tidemap_session']}"}
            socket = connect(_ws(other.url + PATHS[0]), additional_headers=cookie, proxy=None)
            browser.post("/logout")
        assert _close_code(socket) == 4401
        assert httpx.get(f"{other.url}/api/v1/locations", headers=cookie, trust_env=False).status_code == 401


def _ws(url: str) -> str:
    return url.replace("http", "ws", 1)


def _close_code(socket: Connection) -> int | None:
    """The code the server closes with, once all it had to say is read."""
    while True:
        try:
            socket.recv(timeout=WAIT_S)
        except ConnectionClosed as closed:
            return closed.rcvd.code if closed.rcvd else None
