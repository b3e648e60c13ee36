"""Behind nginx and Caddy, as docker/proxies configures them: people sign in, look and listen, robots post."""

import ssl
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest
import yaml
from playwright.sync_api import Browser, Page, expect

from tests.api.house import ARROW, arrow
from tests.e2e.test_keys import bearer, make_key
from tests.support.chromium import driving
from tests.support.proxies import EXAMPLES, PROXIES, nginx
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import SHAPE, START, make_grid
from tests.support.waiting import WAIT_S

LARGE_BYTES = 60 * 10**6
LISTEN = """() => {
  window.heard = {};
  const socket = new WebSocket(location.origin.replace('http', 'ws') + '/api/v1/events?kind=observation');
  socket.onmessage = (event) => { window.heard.socket = JSON.parse(event.data).location; };
  const stream = new EventSource('/api/v1/events?kind=observation');
  stream.onmessage = (event) => { window.heard.stream = JSON.parse(event.data).location; };
  return Promise.all([socket, stream].map((each) => new Promise((done) => { each.onopen = () => done(true); })));
}"""


@dataclass
class Front:
    """A proxy with a server behind it."""

    url: str
    key: str
    server: ServerProcess

    def post(self, path: str, content: bytes, media_type: str) -> httpx.Response:
        """Post through the proxy."""
        headers = {"Content-Type": media_type, **bearer(self.key)}
        address = f"{self.url}/api/v1{path}"
        return httpx.post(address, content=content, headers=headers, timeout=WAIT_S, verify=False, trust_env=False)


@pytest.fixture(scope="module")
def keyed(module_server: StartServer) -> tuple[ServerProcess, str]:
    """A server with a grid and an admin's key."""
    running = module_server(env={"TIDEMAP_UPDATER": "false"})
    make_grid(running.url, "lab", days=2)
    return running, str(make_key(("--data", str(running.data)), "admin")["key"])


@pytest.fixture(scope="module", params=PROXIES)
def front(
    request: pytest.FixtureRequest, keyed: tuple[ServerProcess, str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Front]:
    server, key = keyed
    with PROXIES[request.param](server, tmp_path_factory.mktemp("proxy")) as url:
        yield Front(url, key, server)


@pytest.fixture
def tab(browser: Browser, front: Front) -> Iterator[Page]:
    """A page of a browser that takes the certificate."""
    with driving(browser), browser.new_context(ignore_https_errors=True, base_url=front.url) as context:
        yield context.new_page()


def until_true(tab: Page, function: str) -> None:
    """Wait for a function of the page; the page's policy lets no script of Playwright's own wait for it."""
    deadline = time.monotonic() + WAIT_S
    while not tab.evaluate(function):
        assert time.monotonic() < deadline, function
        tab.wait_for_timeout(30)


def test_people_sign_in_look_and_listen(front: Front, tab: Page) -> None:
    tab.goto("/locations/lab")
    for wrong in ("tm_wrong", "x" * 20_000):
        tab.get_by_label("Key").fill(wrong)
        with tab.expect_response(lambda answer: answer.request.method == "POST") as answered:
            tab.get_by_role("button", name="Sign in").click()
        assert answered.value.status in (401, 413)
        assert answered.value.header_value("content-type") == "text/html; charset=utf-8"
        expect(tab.locator("#problem")).to_be_visible()
    tab.get_by_label("Key").fill(front.key)
    tab.get_by_role("button", name="Sign in").click()
    expect(tab.get_by_role("heading", level=1)).to_have_text("Locations")
    (cookie,) = tab.context.cookies()
    assert cookie["secure"], "the server knows that it is https"
    tab.goto("/view/?location=lab")
    until_true(tab, "async () => (await (await fetch('/view/sessions')).json()).some((tab) => tab.updates >= 1)")
    assert tab.evaluate(LISTEN) == [True, True]
    posted = front.post("/locations/lab/observations", b'{"observations":[{"time":0,"free":[0]}]}', "application/json")
    assert posted.status_code == 201
    until_true(tab, "() => window.heard.socket === 'lab' && window.heard.stream === 'lab'")


def test_a_large_post_comes_through(front: Front) -> None:
    cells = int(np.prod(SHAPE))
    rows = LARGE_BYTES // 13
    columns = {
        "time": START.timestamp() - 1800.0 * (np.arange(rows) // cells),
        "cell": (np.arange(rows) % cells).astype(np.uint32),
        "state": np.zeros(rows, np.uint8),
    }
    body = arrow(columns)
    assert len(body) > LARGE_BYTES
    answer = front.post("/locations/lab/observations", body, ARROW)
    assert (answer.status_code, answer.json()["accepted"]) == (201, rows)


def test_the_server_knows_who_asks(front: Front) -> None:
    """Wrong keys are counted by address, and a client may not say that it has another one."""
    answer = httpx.get(
        f"{front.url}/api/v1/locations",
        headers={"X-Request-ID": "mine", "X-Forwarded-For": "203.0.113.9", **bearer(front.key)},
        verify=ssl._create_unverified_context(),
        trust_env=False,
    )
    assert answer.status_code == 200
    assert answer.headers["x-request-id"] not in ("", "mine"), "the proxy's"


def test_a_proxy_that_keeps_the_host_to_itself_is_told_of_on_the_form(
    keyed: tuple[ServerProcess, str], tmp_path: Path
) -> None:
    server, key = keyed
    with nginx(server, tmp_path, **{"proxy_set_header Host $http_host;": ""}) as url:
        answer = httpx.post(
            f"{url}/login", data={"key": key}, headers={"Origin": url}, verify=False, trust_env=False, timeout=WAIT_S
        )
    assert answer.status_code == 403
    assert answer.headers["content-type"].startswith("text/html")
    assert "Host" in answer.text


def test_the_example_for_traefik_is_whole() -> None:
    http = yaml.safe_load((EXAMPLES / "traefik.yaml").read_text())["http"]
    (router,) = http["routers"].values()
    assert http["services"][router["service"]]["loadBalancer"]["passHostHeader"] is True
    assert set(router["middlewares"]) == http["middlewares"].keys()
