"""Locations for the pages, and what the browser complains about."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, Request

from tests.support.viewer import post
from tests.support.waiting import WAIT_S

START = datetime(2026, 3, 2, tzinfo=UTC)
DAYS = 14
SERIOUS = {"moderate", "serious", "critical"}
PAGES = (
    "/",
    "/anomalies",
    "/new",
    "/locations/office-door",
    "/locations/office-door/report",
    "/locations/lab?cell=121",
    "/view/?location=lab",
    "/api/docs",
    "/nowhere",
)
"""Every kind of page, of a server with a door and a lab."""
QUIET_S = 0.5
VIEWER = "/view/scene/"
"""What viser serves: its own client, some megabytes, which browsers keep."""


def make_door(url: str, name: str) -> None:
    """A door that is open from 08:00 to 18:00 every day, with a model; then open once at 03:00."""
    post(url, "/locations", {"name": name, "kind": "state", "interval_s": 600, "time_zone": "Europe/London"})
    moments = [START + timedelta(minutes=10 * i) for i in range(144 * DAYS)]
    body = {
        "time": [moment.timestamp() for moment in moments],
        "state": [int(8 <= moment.hour < 18) for moment in moments],
    }
    post(url, f"/locations/{name}/observations", body)
    assert post(url, f"/locations/{name}/update?wait=60", {"estimator": "fft", "order": 3})["state"] == "done"
    at_night = (START + timedelta(days=DAYS, hours=3)).timestamp()
    answer = post(url, f"/locations/{name}/observations", {"time": [at_night], "state": [1]})
    assert len(answer["anomalies"]) == 1


@contextmanager
def no_complaints(page: Page, but: str | None = None) -> Iterator[None]:
    """The browser has nothing to complain about meanwhile, such as breaches of the content security policy.

    `but`: of what holds this text.
    """
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    yield
    assert [each for each in said if but is None or but not in each] == []


@dataclass
class Load:
    """What a page asked for: addresses, and bytes on the wire without those of viser's own client."""

    asked: list[str]
    n_bytes: int


@contextmanager
def loading(page: Page) -> Iterator[Load]:
    """Notes what a page asks for meanwhile, with the frames in it, until the network is quiet."""
    load = Load([], 0)
    addresses: dict[str, str] = {}
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")

    def ask(event: dict[str, Any]) -> None:
        addresses[event["requestId"]] = event["request"]["url"]
        load.asked.append(event["request"]["url"])

    def end(event: dict[str, Any]) -> None:
        address = addresses.get(event["requestId"], "")
        if address.startswith("http") and VIEWER not in address:
            load.n_bytes += event["encodedDataLength"]

    session.on("Network.requestWillBeSent", ask)
    session.on("Network.loadingFinished", end)
    with quiet_afterwards(page):
        yield load


@contextmanager
def quiet_afterwards(page: Page) -> Iterator[None]:
    """Ends when for half a second nothing that was asked for meanwhile is under way, in the page and its frames.

    Playwright's own `networkidle` never comes now and then, where a frame is in a frame.
    """
    asked: set[Request] = set()
    last = [time.monotonic()]

    def note(change: Callable[[Request], None]) -> Callable[[Request], None]:
        def noted(request: Request) -> None:
            change(request)
            last[0] = time.monotonic()

        return noted

    page.on("request", note(asked.add))
    for ended in ("requestfinished", "requestfailed"):
        page.on(ended, note(asked.discard))
    yield
    deadline = time.monotonic() + WAIT_S
    while asked or time.monotonic() < last[0] + QUIET_S:
        assert time.monotonic() < deadline, f"still under way: {[each.url for each in asked]}"
        page.wait_for_timeout(50)


def barriers(page: Page) -> list[str]:
    """What keeps some people from using the page, as axe finds it: moderate and worse."""
    found = Axe().run(page).response["violations"]
    return [
        f"{each['id']} ({each['impact']}): {each['nodes'][0]['html'][:120]}"
        for each in found
        if each["impact"] in SERIOUS
    ]
