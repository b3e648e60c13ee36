"""Sockets that may not open are answered 401, 403 or 404, and leave nothing in the log."""

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.e2e.test_keys import bearer, make_key
from tests.support.server import ServerProcess, StartServer

PATHS = ["/api/v1/events", "/view/control/0123456789abcdef", "/view/scene/0123456789abcdef"]
FLOOD = 40


@pytest.fixture(scope="module")
def keyed(module_server: StartServer) -> tuple[ServerProcess, dict[str, str]]:
    """A server with a key of each role."""
    running = module_server(env={"TIDEMAP_WRONG_KEYS_PER_MINUTE": "0"})
    where = ("--data", str(running.data))
    return running, {role: str(make_key(where, role)["key"]) for role in ("robot", "operator")}


def refusal(server: ServerProcess, path: str, headers: dict[str, str]) -> int:
    """The status that an upgrade is answered with."""
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{server.port}{path}", additional_headers=headers, proxy=None)
    return int(refused.value.response.status_code)


@pytest.mark.parametrize("path", PATHS)
def test_a_flood_of_refused_sockets_leaves_the_log_quiet(
    keyed: tuple[ServerProcess, dict[str, str]], path: str
) -> None:
    server, keys = keyed
    for _ in range(FLOOD):
        assert refusal(server, path, {}) == 401
        assert refusal(server, path, bearer("tm_wrong")) == 401
        assert refusal(server, path, {"Cookie": "tidemap_session=1.9999999999.abc"}) == 401
        assert refusal(server, path, bearer(keys["robot"])) == 403
    assert refusal(server, path, {"Cookie": "tidemap_session=x", "Origin": "http://evil.example"}) == 403
    said = server.output()
    assert "ERROR" not in said
    assert "Traceback" not in said


@pytest.mark.parametrize("path", ["/view/control/short", "/view/scene/0123456789abcdef"])
def test_a_tab_that_is_not_open_is_not_found(keyed: tuple[ServerProcess, dict[str, str]], path: str) -> None:
    server, keys = keyed
    assert refusal(server, path, bearer(keys["operator"])) == 404
