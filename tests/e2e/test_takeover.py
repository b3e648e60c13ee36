"""A link must not take over who is signed in: the scene takes no foreign server, and no script from messages."""

import contextlib
from collections.abc import Iterator
from urllib.parse import quote

import pytest
import viser
from playwright.sync_api import Page
from viser._messages import RunJavascriptMessage

from tests.support.server import ServerProcess
from tidemap_web.viewer.client import scene_address


@pytest.fixture
def foreign() -> Iterator[viser.ViserServer]:
    """A viser server of somebody else, which sends a script to everybody."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server._websock_server.queue_message(RunJavascriptMessage("document.documentElement.dataset.taken = '1'"))
    yield server
    server.stop()


@pytest.mark.parametrize("way", ["/view/scene/?{}", "/login?next={}", "/view/scene/?v=1&fixedDpr=1&{}"])
def test_a_link_to_a_foreign_server_opens_nothing_of_it(
    shared_server: ServerProcess, foreign: viser.ViserServer, page: Page, way: str
) -> None:
    query = f"websocket=ws://127.0.0.1:{foreign.get_port()}&playbackPath=/x"
    page.goto(shared_server.url + way.format(quote(f"/view/scene/?{query}", safe="") if "next" in way else query))
    page.wait_for_timeout(3000)
    assert "websocket" not in page.url or "127.0.0.1:" + str(foreign.get_port()) not in page.url
    assert not foreign.get_clients()
    assert page.evaluate("document.documentElement.dataset.taken") is None


def test_the_policy_keeps_the_scene_from_other_hosts_and_from_scripts_of_messages(
    shared_server: ServerProcess, foreign: viser.ViserServer, page: Page
) -> None:
    page.goto(shared_server.url + scene_address())
    address = f"ws://127.0.0.1:{foreign.get_port()}"
    assert page.evaluate(_REACHES, address) == "connect-src"
    with contextlib.suppress(Exception):
        page.add_script_tag(content="document.documentElement.dataset.taken = '1'")
    assert page.evaluate("document.documentElement.dataset.taken") is None


_REACHES = """address => new Promise(settle => {
  document.addEventListener("securitypolicyviolation", event => {
    if (event.effectiveDirective === "connect-src") settle(event.effectiveDirective);
  });
  const socket = new WebSocket(address, ["viser-v1.1.1"]);
  socket.onopen = () => settle("open");
})"""
