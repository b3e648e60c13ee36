"""The 3D viewer in a real browser on a real server: what it shows, in exact colours, and what hands can do."""

import os
import subprocess
from dataclasses import dataclass
from datetime import datetime, timedelta

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.test_keys import make_key
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import (
    FLOOR,
    SHUTTER,
    START,
    WALL,
    Viewer,
    cell,
    color_of,
    look_around,
    make_grid,
    post,
)
from tidemap_web.viewer import colors

NIGHT = START + timedelta(days=9, hours=3)
MORNING = START + timedelta(days=9, hours=8, minutes=30)
EVENING = START + timedelta(days=9, hours=19)


@dataclass
class Lab:
    """A server with the grid 'lab', last looked at at `last`."""

    url: str
    last: datetime


@pytest.fixture(scope="module")
def lab(shared_server: ServerProcess) -> Lab:
    """The grid that most tests look at."""
    return Lab(shared_server.url, make_grid(shared_server.url, "lab"))


def test_predicted_and_observed_stand_side_by_side(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING)
    certain = color_of(lab.url, "lab", MORNING, WALL[0])
    assert certain == colors.OCCUPIED
    viewer.until(lambda: viewer.shows(certain, "left") > 1000)
    viewer.until(lambda: viewer.shows(certain, "right") > 1000)
    expect(page.locator("#date")).to_have_text("Wed 11 Mar 2026")
    expect(page.locator("#clock")).to_have_text("08:30:00")
    expect(page.locator("#zone")).to_have_text("Europe/London (GMT)")


def test_what_is_always_occupied_is_grey_until_one_wants_it_coloured(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING, dim=True)
    _, top = colors.STRUCTURE
    viewer.until(lambda: viewer.shows(top, "left") > 200 and viewer.shows(top, "right") > 200)
    assert viewer.shows(colors.OCCUPIED, "left") == 0
    page.get_by_label("Grey what is always occupied").uncheck()
    viewer.until(lambda: viewer.shows(colors.OCCUPIED, "left") > 1000)
    assert viewer.shows(top, "left") == 0


def test_night_and_morning_have_the_colours_of_the_legend(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING)
    by_day = color_of(lab.url, "lab", MORNING, SHUTTER[0])
    in_the_evening = color_of(lab.url, "lab", EVENING, SHUTTER[0])
    assert len({by_day, in_the_evening, colors.OCCUPIED}) == 3

    viewer.until(lambda: viewer.shows(by_day, "left") > 200)
    assert viewer.shows(in_the_evening, "left") == 0
    viewer.go(EVENING)
    viewer.until(lambda: viewer.shows(in_the_evening, "left") > 200)
    assert viewer.shows(by_day, "left") == 0
    viewer.go(NIGHT)  # so unlikely now that it is hidden
    viewer.until(lambda: viewer.shows(in_the_evening, "left") == 0)
    assert viewer.shows(by_day, "left") == 0
    assert viewer.shows(colors.OCCUPIED, "left") > 1000


def test_a_known_cell_has_its_colour_where_it_is(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING)
    front = (5, 0, 1)
    expected = color_of(lab.url, "lab", MORNING, front)
    viewer.until(lambda: viewer.shows(expected, "left") > 200)
    x, y = viewer.pixel_of(front)
    assert tuple(viewer.pixels()[y, x]) == expected
    viewer.go(NIGHT)
    viewer.until(lambda: viewer.shows(expected, "left") == 0)
    assert tuple(viewer.pixels()[y, x]) != expected


def test_two_tabs_keep_their_own_time(lab: Lab, page: Page) -> None:
    first = Viewer.open(page, lab.url, "lab", MORNING)
    second = Viewer.open(page.context.new_page(), lab.url, "lab", NIGHT)
    by_day = color_of(lab.url, "lab", MORNING, SHUTTER[0])
    page.bring_to_front()
    first.until(lambda: first.shows(by_day, "left") > 200)
    first.go(MORNING + timedelta(hours=1))
    assert second.session()["time"] == NIGHT.timestamp()
    second.page.bring_to_front()
    second.until(lambda: second.shows(colors.OCCUPIED, "left") > 1000)
    assert second.shows(by_day, "left") == 0


def test_a_click_inspects_a_cell(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING)
    front = (5, 0, 1)
    viewer.until(lambda: viewer.shows(color_of(lab.url, "lab", MORNING, front), "left") > 200)
    x, y = viewer.pixel_of(front)
    page.locator("#scene").click(position={"x": x, "y": y})
    facts = page.locator("#selected-facts")
    expect(facts).to_contain_text("[5, 0, 1]")
    expect(facts).to_contain_text(str(cell(front)))
    expect(facts).to_contain_text("3.75, -1.75, 0.75 m")
    expect(facts).to_contain_text("occupied")
    expect(facts.get_by_role("link")).to_have_attribute("href", f"/locations/lab?cell={cell(front)}")
    viewer.until(lambda: viewer.shows_about(colors.SELECTED, "right") > 10)


def test_hands_and_keys_move_the_time(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING)
    page.get_by_role("button", name="+1 h").click()
    expect(page.locator("#clock")).to_have_text("09:30:00")
    page.keyboard.press("Shift+ArrowLeft")
    expect(page.locator("#date")).to_have_text("Tue 10 Mar 2026")
    page.keyboard.press(".")
    expect(page.locator("#clock")).to_have_text("10:00:00")
    page.wait_for_url("**time=1773136800*")  # a link to this moment
    page.keyboard.press("l")
    viewer.until(lambda: viewer.session()["time"] == lab.last.timestamp())
    expect(page.locator("#tense")).to_have_text("newest")
    page.get_by_role("button", name="+1 d").click()
    expect(page.locator("#tense")).to_have_text("forecast, +24 h")


def test_playing_moves_on_and_pausing_stops(lab: Lab, page: Page) -> None:
    viewer = Viewer.open(page, lab.url, "lab", MORNING, dim=True)
    page.keyboard.press(" ")
    viewer.until(lambda: float(str(viewer.session()["time"])) > MORNING.timestamp() + 3600)
    page.keyboard.press(" ")
    expect(page.locator("#play")).to_have_attribute("aria-pressed", "false")
    viewer.until(lambda: viewer.session()["idle"])
    stood = viewer.session()["time"]
    page.wait_for_timeout(300)
    assert viewer.session()["time"] == stood


def test_a_time_is_also_read_as_iso(lab: Lab, page: Page) -> None:
    page.goto(f"{lab.url}/view/?location=lab&time=2026-03-11T03:00:00Z")
    expect(page.locator("#clock")).to_have_text("03:00:00")


def test_an_unknown_grid_is_said_to_be_unknown(lab: Lab, page: Page) -> None:
    page.goto(f"{lab.url}/view/?location=<b>nowhere</b>")
    expect(page.locator("#notice-title")).to_have_text("No such grid")
    expect(page.locator("#notice-text")).to_contain_text("<b>nowhere</b>")


def test_live_follows_new_observations_and_marks_what_is_abnormal(server: StartServer, page: Page) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false"})
    last = make_grid(process.url, "yard", days=8)
    viewer = Viewer.open(page, process.url, "yard")
    assert viewer.session()["time"] == last.timestamp()
    assert viewer.shows(colors.UNEXPECTED, "right") == 0

    later = last + timedelta(minutes=30)
    box = FLOOR[8:12]
    post(process.url, "/locations/yard/observations", {"observations": [look_around(later, box)]})
    viewer.until(lambda: viewer.session()["time"] == later.timestamp())
    viewer.until(lambda: viewer.shows(colors.UNEXPECTED, "right") > 100)
    assert viewer.shows(colors.UNEXPECTED, "left") == 0
    expect(page.locator("#unexpected")).to_have_text(str(len(box)))


def test_without_a_grid_it_says_what_to_do_and_before_a_model_it_shows_what_was_seen(
    server: StartServer, page: Page
) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false"})
    page.goto(f"{process.url}/view/")
    expect(page.locator("#notice-title")).to_have_text("No grid yet")
    expect(page.locator("#slice")).to_be_hidden()
    for then in ("Nothing observed yet", None):
        shown = page.locator("#notice-code").inner_text()
        subprocess.run(["sh", "-ec", shown], env=os.environ | {"NO_PROXY": "*"}, check=True)
        if then is not None:
            expect(page.locator("#notice-title")).to_have_text(then)
    expect(page.locator("#notice")).to_be_hidden()

    post(
        process.url,
        "/locations",
        {
            "name": "attic",
            "kind": "grid2d",
            "interval_s": 60,
            "grid": {"resolution_m": 1, "shape": [2, 2]},
        },
    )
    page.goto(f"{process.url}/view/")
    expect(page.locator("#notice-title")).to_have_text("Nothing observed yet")

    seen = {"time": START.isoformat(), "occupied": [[0, 1], [1, 1]], "free": [[0, 0]]}
    post(process.url, "/locations/attic/observations", {"observations": [seen]})
    viewer = Viewer.open(page, process.url, "attic")
    viewer.until(lambda: viewer.shows(colors.OCCUPIED, "right") > 100)
    assert viewer.shows(colors.OCCUPIED, "left") == 0
    expect(page.locator("#model")).to_have_text("no model yet: first update at 2 measurements")
    post(process.url, "/locations/attic/update?wait=60", {})
    expect(page.locator("#model")).to_have_text("revision 1 (static)")


def test_a_server_with_keys_shows_it_to_nobody_without(server: StartServer, page: Page) -> None:
    process = server()
    make_key(("--data", str(process.data)), "operator")
    for path in ("/view/scene/", "/view/sessions"):
        assert httpx.get(process.url + path, trust_env=False).status_code == 401
    answer = httpx.get(process.url + "/view/?location=lab", trust_env=False)
    assert answer.status_code == 303
    assert answer.headers["location"] == "/login?next=%2Fview%2F%3Flocation%3Dlab"
    page.goto(f"{process.url}/login")
    for path in ("/view/control/0123456789abcdef", "/view/scene/0123456789abcdef"):
        assert page.evaluate(_REFUSED, process.url.replace("http", "ws") + path)


_REFUSED = """address => new Promise(settle => {
  const socket = new WebSocket(address, address.includes("/scene/") ? ["viser-v1.1.1"] : []);
  socket.onopen = () => settle(false);
  socket.onclose = () => settle(true);
})"""
