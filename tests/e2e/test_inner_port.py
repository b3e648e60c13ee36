"""Viser's own port, beside ours: other programs and pages on this machine get nothing from it."""

import httpx
import psutil
import pytest
import viser
from playwright.sync_api import Page
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.support.server import ServerProcess
from tests.support.viewer import Viewer, make_grid

SPOKEN = [Subprotocol(f"viser-v{viser.__version__}")]
WRONG = {"Tidemap-Viewer": "x" * 43}


def inner_port(server: ServerProcess) -> int:
    listening = [each for each in psutil.Process(server.process.pid).net_connections("tcp") if each.status == "LISTEN"]
    (port,) = {each.laddr.port for each in listening} - {server.port}
    return int(port)


@pytest.mark.parametrize("headers", [{}, WRONG, {"Origin": "http://127.0.0.1"}])
def test_a_stranger_gets_nothing(shared_server: ServerProcess, page: Page, headers: dict[str, str]) -> None:
    name = f"grid-{len(headers)}-{next(iter(headers), 'none')}"
    make_grid(shared_server.url, name, days=1)
    token = Viewer.open(page, shared_server.url, name).page.evaluate("document.body.dataset.token")
    port = inner_port(shared_server)
    address = f"ws://127.0.0.1:{port}/?token={token}"
    with pytest.raises(InvalidStatus) as refusal:
        connect(address, subprotocols=SPOKEN, additional_headers=headers, proxy=None)
    assert refusal.value.response.status_code == 403
    assert httpx.get(f"http://127.0.0.1:{port}/", headers=headers, trust_env=False).status_code == 403
