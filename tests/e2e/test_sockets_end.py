"""A socket ends with the key or session that opened it, in every process."""

import httpx
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.e2e.test_keys import make_key
from tests.support.here import command
from tests.support.server import StartServer
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


def _ws(url: str) -> str:
    return url.replace("http", "ws", 1)


def _close_code(socket: ClientConnection) -> int | None:
    """The code the server closes with, once all it had to say is read."""
    while True:
        try:
            socket.recv(timeout=WAIT_S)
        except ConnectionClosed as closed:
            return closed.rcvd.code if closed.rcvd else None
