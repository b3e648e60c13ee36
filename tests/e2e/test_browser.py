"""The browser that tests get can do what the viewer needs, and leaves other tests alone."""

import asyncio

from playwright.sync_api import Page


def test_it_has_webgl(page: Page) -> None:
    assert page.evaluate("Boolean(document.createElement('canvas').getContext('webgl2'))")


def test_a_test_after_it_may_run_an_event_loop() -> None:
    assert asyncio.run(asyncio.sleep(0, "ran")) == "ran"


def test_it_works_again_after_that(page: Page) -> None:
    page.set_content("<h1>Tidemap</h1>")
    assert page.inner_text("h1") == "Tidemap"
