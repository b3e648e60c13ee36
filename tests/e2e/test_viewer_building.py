"""The scene of a building in a real browser: layers, crop, plan, pointer, doors and sensors; a server that hangs."""

import os
import re
import signal
from dataclasses import dataclass
from datetime import datetime, timedelta

import httpx
import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.test_keys import make_key
from tests.support.pages import barriers, no_complaints
from tests.support.scans import files
from tests.support.server import StartServer
from tests.support.viewer import SHUTTER, START, WALL, Viewer, cell, make_grid, post
from tidemap_web.viewer import colors
from tidemap_web.viewer.painting import SWING

MORNING = START + timedelta(days=5, hours=8, minutes=30)
SHUT = (5, 0, 1)
DOORS = {"front-door": ([6.5, -1.0, 0.75], 1), "store": ([2.0, 0.5, 1.75], 0)}
"""Doors that were always open or closed, in front of the shutter and above the floor."""


@dataclass
class Hall:
    """A server with the grid 'hall', which was last seen at `last`."""

    url: str
    last: datetime


@pytest.fixture(scope="module")
def hall(module_server: StartServer) -> Hall:
    """A grid with two doors in it, and a robot that scanned it in the morning."""
    url = module_server(env={"TIDEMAP_UPDATER": "false"}).url
    last = make_grid(url, "hall", days=8)
    for name, (position, state) in DOORS.items():
        pose = {"frame": "map", "position": position}
        post(url, "/locations", {"name": name, "kind": "state", "interval_s": 1800, "pose": pose})
        times = [START.timestamp() + 1800 * i for i in range(48 * 8)]
        post(url, f"/locations/{name}/observations", {"time": times, "state": [state] * len(times)})
        assert post(url, f"/locations/{name}/update?wait=60", {})["state"] == "done"
    for minutes in (-90, -40, -20, 0):
        way = [5.0 + minutes / 60, 0.0, 0.9, 0, 0, 0, 1]
        header = {"time": (MORNING + timedelta(minutes=minutes)).timestamp(), "map_from_sensor": way}
        scan = files(header, np.full((3, 3), 0.4, np.float32))
        path = f"{url}/api/v1/locations/hall/scans?source=spot"
        answer = httpx.post(path, files=scan, trust_env=False)
        assert answer.status_code == 201, answer.text
    return Hall(url, last)


def rgb(value: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> colors.Rgb:
    red, green, blue = value.tolist()
    return red, green, blue


def test_the_amplitude_of_the_day_has_the_colour_of_its_legend(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING)
    page.locator("#predicted-layer").select_option("day")
    page.wait_for_url("**predicted=day*")
    expect(page.get_by_text("amplitude of p over the day")).to_be_visible()
    midnight = MORNING.replace(hour=0, minute=0).timestamp()
    asked = {"time": [midnight + 3600 * hour for hour in range(24)], "cell": [cell(SHUT)], "given": "model"}
    p = np.array(post(hall.url, "/locations/hall/predict", asked)["probability"][0])
    amplitude = abs(p @ np.exp(-2j * np.pi * np.arange(24) / 24)) / 12
    assert amplitude > 0.4
    expected = rgb(colors.of_probability(np.array([amplitude / SWING]))[0])
    viewer.until(lambda: viewer.shows(expected, "left") > 200)
    assert viewer.session()["predicted"] == len(SHUTTER)  # walls have no rhythm
    page.get_by_label("Grey what is always occupied").check()
    viewer.until(lambda: viewer.shows(colors.STRUCTURE[1], "left") > 100)


def test_a_crop_shows_a_box_and_is_in_the_link(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING)
    page.locator("#crop summary").click()
    assert page.locator("#crop-x-value").inner_text() == "1.00 – 6.00 m"
    page.get_by_label("Last along x").fill("4")
    page.get_by_label("First along y").fill("5")
    expect(page.locator("#crop-x-value")).to_have_text("1.00 – 3.50 m")
    expect(page.locator("#crop-y-value")).to_have_text("0.50 – 1.00 m")
    kept = [each for each in WALL if each[0] <= 4]
    viewer.until(lambda: viewer.session()["predicted"] == viewer.session()["observed"] == len(kept))
    page.wait_for_url("**crop=0-4%2C5-5*")
    page.reload()
    viewer.until(lambda: viewer.session()["idle"] and viewer.session()["predicted"] == len(kept))
    page.get_by_label("First along x").focus()
    page.keyboard.press("ArrowRight")
    viewer.until(lambda: viewer.session()["predicted"] == len(kept) - 4)
    page.get_by_role("button", name="Show all of it").click()
    viewer.until(lambda: viewer.session()["observed"] > len(WALL))
    assert "crop" not in page.url
    page.go_back()
    viewer.until(lambda: viewer.session()["predicted"] == len(kept) - 4)


def test_from_above_what_stands_on_another_covers_it(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING)

    def lean() -> float:
        """How far the top of a wall is from its foot, in pixels."""
        foot, top = (np.array(viewer.pixel_of((9, 5, k))) for k in (0, 3))
        return float(np.hypot(*(foot - top)))

    assert lean() > 30
    page.get_by_role("button", name="From above").click()
    viewer.until(lambda: lean() <= 2)
    viewer.until(lambda: viewer.shows(colors.OCCUPIED, "left") > 500)
    box = page.locator("#scene").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.wheel(0, -300)
    page.wait_for_url(re.compile("camera=.*0\\.02(&|$)"))
    page.reload()
    viewer.until(lambda: viewer.session()["updates"] and lean() <= 2)
    page.keyboard.press("1")
    viewer.until(lambda: lean() > 30)


def test_the_pointer_says_what_is_under_it(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING)
    viewer.until(lambda: viewer.shows(colors.OCCUPIED, "left") > 1000)
    box = page.locator("#scene").bounding_box()
    assert box is not None
    x, y = viewer.pixel_of((4, 0, 2))
    page.mouse.move(box["x"] + x, box["y"] + y)
    tip = page.locator("#pointed")
    expect(tip).to_contain_text(
        re.compile(r"^\[4, 0, 2\] · probability 0\.\d\d, uncertain · last seen occupied, 0 s before$")
    )
    page.get_by_role("button", name="+1 h").press("Enter")
    expect(tip).to_contain_text("last seen occupied")
    page.mouse.move(box["x"] + 3, box["y"] + 3)
    expect(tip).to_be_hidden()


def test_doors_stand_in_the_scene_as_they_are_with_the_way_to_their_pages(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING, dim=True)
    viewer.until(lambda: viewer.shows(colors.FREE, "left") > 50 and viewer.shows(colors.FREE, "right") > 50)
    items = page.locator("#building-list li")
    expect(items).to_contain_text(["front-door", "store"])
    expect(items.first).to_contain_text(re.compile(r"occupied, (1\.00|0\.9\d)"))
    link = page.get_by_role("link", name="store")
    assert link.get_attribute("href") == f"/locations/store?time={MORNING.timestamp():.0f}"
    pixels = viewer.pixels()
    found = np.argwhere((pixels == np.array(colors.FREE, np.uint8)).all(axis=2))
    y, x = found[found[:, 1] < pixels.shape[1] // 2].mean(axis=0).astype(int).tolist()
    box = page.locator("#scene").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + x, box["y"] + y)
    expect(page.locator("#pointed")).to_contain_text("store · probability 0.0")
    page.mouse.click(box["x"] + x, box["y"] + y)
    expect(page.locator("#building-list .chosen")).to_contain_text("store")
    later = (hall.last + timedelta(minutes=30)).timestamp()
    viewer.go(hall.last)
    post(hall.url, "/locations/store/observations", {"time": [later], "state": [1]})
    page.get_by_label("Go to a moment", exact=True).fill("+30 min")
    page.get_by_role("button", name="Go", exact=True).click()
    viewer.until(lambda: viewer.shows(colors.UNEXPECTED, "right") > 50)
    with no_complaints(page):
        assert barriers(page) == []
        link.click()
        expect(page.get_by_role("heading", level=1)).to_contain_text("store")


def test_sensors_stand_where_they_were_with_the_way_of_the_last_hour(hall: Hall, page: Page) -> None:
    viewer = Viewer.open(page, hall.url, "hall", MORNING, dim=True)
    expect(page.locator("#sensors-legend")).to_be_visible()
    viewer.until(lambda: viewer.shows(colors.TRACK, "right") > 10)
    viewer.go(MORNING + timedelta(minutes=90))
    expect(page.locator("#sensors-legend")).to_be_hidden()
    viewer.until(lambda: viewer.shows(colors.TRACK, "right") == 0)


def test_a_server_that_hangs_is_noticed_and_so_is_its_return(server: StartServer, page: Page) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false"})
    make_grid(process.url, "yard", days=2)
    Viewer.open(page, process.url, "yard", dim=True)
    sign = page.locator("#silent")
    expect(sign).to_be_hidden()
    os.kill(process.process.pid, signal.SIGSTOP)
    try:
        expect(sign).to_have_text(re.compile(r"^No answer since \d\d:\d\d:\d\d\. "), timeout=20_000)
    finally:
        os.kill(process.process.pid, signal.SIGCONT)
    expect(sign).to_be_hidden()
    expect(page.locator("#notice")).to_be_hidden()


def test_one_key_opens_so_many_tabs_and_the_one_too_many_waits(server: StartServer, page: Page) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER_TABS": "1"})
    make_grid(process.url, "yard", days=2)
    key = make_key(("--data", str(process.data)), "operator")["key"]
    page.goto(f"{process.url}/login?next=/view/")
    page.get_by_label("Key").fill(key)
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator("#tense")).to_have_text("newest")
    other = page.context.new_page()
    other.goto(f"{process.url}/view/")
    expect(other.locator("#notice-title")).to_have_text("Too many viewers")
    expect(other.locator("#notice-text")).to_contain_text("1 tabs of the viewer are open with this key")
    page.close()
    expect(other.locator("#tense")).to_have_text("newest", timeout=20_000)
    expect(other.locator("#notice")).to_be_hidden()
