"""pages: time from the request of a page to its first content in Chromium, of the slowest page; nothing is cached.

Each page is opened by a browser that never saw it, some times; the least counts. The details are those of each page.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser

from tests.bench.timing import Figure
from tests.support.chromium import driving, find_chromium, launch
from tests.support.pages import PAGES, make_door
from tests.support.server import ServerProcess
from tests.support.viewer import make_grid

MAX_MS = 1000.0
ROUNDS = 3
_FIRST_CONTENT = """async () => {
  for (;;) {
    const [entry] = performance.getEntriesByName("first-contentful-paint");
    if (entry) return entry.startTime;
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}"""


def measure() -> Figure:
    executable = find_chromium()
    assert executable is not None, "this figure needs Chromium"
    with TemporaryDirectory() as folder, launch(executable) as browser, driving(browser):
        server = ServerProcess(Path(folder))
        try:
            make_door(server.url, "office-door")
            make_grid(server.url, "lab", days=8)
            taken = {path: min(_opened_ms(browser, server.url + path) for _ in range(ROUNDS)) for path in PAGES}
        finally:
            server.stop()
    return Figure(max(taken.values()), MAX_MS, 1.0, "ms", {path: round(each) for path, each in taken.items()})


def _opened_ms(browser: Browser, address: str) -> float:
    with browser.new_context(viewport={"width": 1280, "height": 800}) as context:
        page = context.new_page()
        page.goto(address)
        return float(page.evaluate(_FIRST_CONTENT))
