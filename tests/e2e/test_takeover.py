"""A link must not take over who is signed in: the scene takes no foreign server, and no script from messages."""

import contextlib
from collections.abc import Iterator
from urllib.parse import parse_qs, quote, urlsplit

import pytest
import viser
from playwright.sync_api import Page
from viser._messages import RunJavascriptMessage

from tests.e2e.test_keys import make_key
from tests.support.server import ServerProcess, StartServer
from tidemap_web.viewer.client import scene_address


@pytest.fixture
def foreign() -> Iterator[viser.ViserServer]:
    """A viser server of somebody else, which sends a script to everybody."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    server._websock_server.queue_message(RunJavascriptMessage("document.documentElement.dataset.taken = '1'"))
    yield server
    server.stop()


@pytest.fixture
def query(foreign: viser.ViserServer) -> str:
    """What would lead viser's client to the foreign server."""
    return f"websocket=ws://127.0.0.1:{foreign.get_port()}&playbackPath=/x"


@pytest.fixture(scope="module")
def keyed(module_server: StartServer) -> tuple[ServerProcess, str]:
    """A server with an admin's key."""
    running = module_server()
    return running, str(make_key(("--data", str(running.data)), "admin")["key"])


def sign_in(page: Page, server: ServerProcess, key: str, then: str = "/") -> None:
    page.goto(f"{server.url}/login?next={quote(then, safe='')}")
    page.fill("[name=key]", key)
    page.press("[name=key]", "Enter")
    page.wait_for_url(lambda url: "/login" not in url)


def opens_ours_only(page: Page, server: ServerProcess, foreign: viser.ViserServer, address: str) -> None:
    """Opening an address of the scene leads to the scene of the server; its client connects to that server."""
    with page.expect_console_message(lambda message: message.text.startswith("Connecting to: ")) as said:
        answer = page.goto(server.url + address)
    ours = f"ws://127.0.0.1:{server.port}/view/scene"
    assert said.value.text.startswith(f"Connecting to: {ours} with")
    assert answer is not None
    assert answer.url.removesuffix("&fixedDpr=1") == server.url + scene_address()
    shown = parse_qs(urlsplit(page.url).query)  # viser's client writes into it where it connects to
    assert shown.get("websocket", [ours]) == [ours]
    assert "playbackPath" not in shown
    assert not foreign.get_clients()
    assert page.evaluate("document.documentElement.dataset.taken") is None


@pytest.mark.parametrize("way", ["/view/scene/?{}", "/view/scene/?v=1&fixedDpr=1&{}"])
def test_a_link_to_a_foreign_server_opens_nothing_of_it(
    shared_server: ServerProcess, foreign: viser.ViserServer, query: str, page: Page, way: str
) -> None:
    opens_ours_only(page, shared_server, foreign, way.format(query))


def test_a_link_to_a_foreign_server_opens_nothing_of_it_for_who_is_signed_in(
    keyed: tuple[ServerProcess, str], foreign: viser.ViserServer, query: str, page: Page
) -> None:
    server, key = keyed
    sign_in(page, server, key)
    opens_ours_only(page, server, foreign, f"/view/scene/?{query}")
    made = page.request.get(f"{server.url}/api/v1/keys").json()
    assert [each["role"] for each in made["items"]] == ["admin"]


def test_signing_in_leads_to_no_scene_with_a_foreign_server(
    keyed: tuple[ServerProcess, str], shared_server: ServerProcess, foreign: viser.ViserServer, query: str, page: Page
) -> None:
    server, key = keyed
    link = f"/view/scene/?{query}"
    sign_in(page, server, key, link)
    assert page.url == f"{server.url}/"
    page.goto(f"{shared_server.url}/login?next={quote(link, safe='')}")
    assert page.url == f"{shared_server.url}/"
    assert not foreign.get_clients()


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
