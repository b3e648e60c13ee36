"""The machine's own Chromium, driven by Playwright; nothing is downloaded."""

import asyncio
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PLAYWRIGHT_DISABLES = (
    "AimEnabled",
    "AvoidCorsURLLoaderRestartOnRedirect",
    "AvoidUnnecessaryBeforeUnloadCheckSync",
    "DestroyProfileOnBrowserClose",
    "HttpsFirstBalancedModeAutoEnable",
    "HttpsUpgrades",
    "LensOverlay",
    "MediaRouter",
    "NetworkTimeServiceQuerying",
    "OptimizationHints",
    "PaintHolding",
    "PreconnectToSearch",
    "TcpPortRandomizationWin",
    "ThirdPartyStoragePartitioning",
)
"""Features, named again: of two such switches the last counts."""
ADDRESS_BAR = ("WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup")
"""Features of a window that nobody sees: each page would start a process for them, which takes longer than the page."""
# WebGL in software but pages without, no sandbox (tests may run as root), and nothing that calls home.
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader-webgl",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    f"--disable-features={','.join((*PLAYWRIGHT_DISABLES, *ADDRESS_BAR))}",
)


def find_chromium() -> Path | None:
    """The path of an installed Chromium or Chrome, None without one."""
    return next((Path(found) for name in NAMES if (found := shutil.which(name))), None)


@contextmanager
def launch(executable: Path) -> Iterator[Browser]:
    """A headless browser with a profile of its own.

    Playwright leaves its event loop marked as running between calls, and every `asyncio.run` of another test
    in this process would then fail. So the mark is taken off here; `driving` puts it back for as long as a
    test talks to the browser.
    """
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, headless=True, args=list(FLAGS))
        loop = asyncio.get_running_loop()
        _LOOPS[browser] = loop
        asyncio._set_running_loop(None)
        try:
            yield browser
        finally:
            asyncio._set_running_loop(loop)
            del _LOOPS[browser]
            browser.close()


@contextmanager
def driving(browser: Browser) -> Iterator[None]:
    """Makes `browser` usable within; `asyncio.run` is not, but works in another thread."""
    asyncio._set_running_loop(_LOOPS[browser])
    try:
        yield
    finally:
        asyncio._set_running_loop(None)


_LOOPS: dict[Browser, asyncio.AbstractEventLoop] = {}
