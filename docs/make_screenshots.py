"""Makes the pictures of docs/viewer.md from the demo building: `make screenshots`, or with the address of a running
demo `python -m docs.make_screenshots http://…`.

Without an address it starts a server of its own and fills it, which takes a minute.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from playwright.sync_api import Page, ViewportSize

from tests.support.chromium import driving, find_chromium, launch
from tests.support.paths import ROOT
from tests.support.server import ServerProcess
from tidemap import Client

Scheme = Literal["light", "dark"]
IMAGES = ROOT / "docs" / "images"
BUILDING = "building"
SIZE: ViewportSize = {"width": 1280, "height": 800}
PHONE: ViewportSize = {"width": 390, "height": 844}
SIZES = {"desk": SIZE, "phone": PHONE}
SCHEMES: tuple[Scheme, ...] = ("light", "dark")
SEEDED_S = 600.0
DRAWN_S = 60.0


def main(arguments: list[str]) -> int:
    """Take the pictures; the exit status."""
    executable = find_chromium()
    if executable is None:
        print("There is no Chromium or Chrome on the PATH.", file=sys.stderr)
        return 1
    IMAGES.mkdir(exist_ok=True)
    with demo(arguments) as url, launch(executable) as browser, driving(browser):
        with browser.new_context(viewport=SIZE, color_scheme="light") as context:
            (IMAGES / "viewer.png").write_bytes(view(context.new_page(), url))
        for size, viewport in SIZES.items():
            for scheme in SCHEMES:
                with browser.new_context(viewport=viewport, color_scheme=scheme) as context:
                    lists(context.new_page(), url, f"{size}-{scheme}")
                    plan(context.new_page(), url, f"{size}-{scheme}")
    return 0


@contextmanager
def demo(arguments: list[str]) -> Iterator[str]:
    """The address of a server that holds the demo building."""
    if arguments:
        yield arguments[0]
        return
    with tempfile.TemporaryDirectory() as folder:
        server = ServerProcess(Path(folder), "--demo")
        try:
            wait_until(lambda: "The demo building is ready" in server.output(), SEEDED_S)
            yield server.url
        finally:
            server.stop()


def lists(page: Page, url: str, kind: str) -> None:
    """The pages beside the viewer: all locations, one of them with its report, and all anomalies."""
    with Client(url) as tidemap:
        door = next(each.name for each in tidemap.locations() if each.kind == "state")
    for name, path, drawn_when in (
        ("overview", "/", "svg.spark"),
        ("location", f"/locations/{door}", ".week"),
        ("report", f"/locations/{door}/report", "#week table"),
        ("anomalies", "/anomalies?state=all", "main"),
        ("api", "/api/docs#get_state", "#get_state[open]"),
    ):
        page.goto(url + path)
        page.locator(drawn_when).first.wait_for()
        (IMAGES / f"{name}-{kind}.png").write_bytes(settled(page))


def plan(page: Page, url: str, kind: str) -> None:
    """The same from above, as a plan of the building with its doors and rooms."""
    view(page, url)
    page.keyboard.press("2")
    (IMAGES / f"plan-{kind}.png").write_bytes(settled(page))


def view(page: Page, url: str) -> bytes:
    """The viewer at the moment when most was abnormal at once."""
    with Client(url) as tidemap:
        events = list(tidemap.location(BUILDING).anomalies())
    most = max(events, key=lambda event: (len(event.cells), event.start))
    page.goto(f"{url}/view/?location={BUILDING}&time={most.start}")
    wait_until(lambda: drawn(page), DRAWN_S)
    return settled(page)


def drawn(page: Page) -> bool:
    """Whether the scene is connected and has everything the session wants to show."""
    sessions = page.evaluate("fetch('/view/sessions').then(answer => answer.json())")
    return any(each["idle"] and each["predicted"] for each in sessions)


def settled(page: Page) -> bytes:
    """A picture as soon as two taken one after the other are the same."""
    deadline = time.monotonic() + DRAWN_S
    before, picture = b"", page.screenshot()
    while before != picture and time.monotonic() < deadline:
        time.sleep(1)
        before, picture = picture, page.screenshot()
    return picture


def wait_until(holds: Callable[[], bool], limit_s: float) -> None:
    """Return when `holds()` is true; TimeoutError after `limit_s`."""
    deadline = time.monotonic() + limit_s
    while not holds():
        if time.monotonic() > deadline:
            raise TimeoutError(f"nothing after {limit_s:.0f} s")
        time.sleep(0.2)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
