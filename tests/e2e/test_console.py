"""Our pages run without an error in the browser's console, and what viser's server sends runs no script in them."""

import httpx
import pytest
from playwright.sync_api import Page

from tests.support.pages import quiet_afterwards
from tests.support.server import ServerProcess
from tests.support.viewer import Viewer, make_grid
from tidemap_web.viewer.client import client_page, scene_address


@pytest.fixture(scope="module")
def url(shared_server: ServerProcess) -> str:
    """A server with the grid 'lab'."""
    make_grid(shared_server.url, "lab", days=1)
    return shared_server.url


@pytest.fixture
def errors(page: Page) -> list[str]:
    """What the page's console, and those of its frames and workers, call an error."""
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(f"uncaught: {error}"))
    return said


@pytest.mark.parametrize("path", ["/", "/locations/lab"])
def test_a_page_says_no_error(url: str, page: Page, errors: list[str], path: str) -> None:
    with quiet_afterwards(page):
        page.goto(url + path, wait_until="load")
    assert errors == []


def test_the_viewer_and_its_scene_say_no_error(url: str, page: Page, errors: list[str]) -> None:
    viewer = Viewer.open(page, url, "lab")
    viewer.until(lambda: viewer.pixels().std() > 0)
    assert errors == []


def test_the_scene_page_is_asked_for_each_time(url: str) -> None:
    address = url + scene_address()
    first = httpx.get(address, trust_env=False)
    assert first.headers["cache-control"] == "private, no-cache"
    again = httpx.get(address, headers={"If-None-Match": first.headers["etag"]}, trust_env=False)
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["content-security-policy"] == client_page().csp
    old = httpx.get(address, headers={"If-None-Match": '"1.1.1-00000000"'}, trust_env=False)
    assert (old.status_code, old.content) == (200, first.content)
