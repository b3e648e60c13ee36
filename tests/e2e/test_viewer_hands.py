"""What an operator does in the viewer, in a real browser: links, Back, marks, keys, typed moments, other tabs."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.test_keys import make_key
from tests.support.pages import barriers, no_complaints
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import FLOOR, START, WALL, Viewer, cell, color_of, look_around, make_grid, post
from tidemap.api.auth import RECHECK_S

MORNING = START + timedelta(days=5, hours=8, minutes=30)
SHUT = (5, 0, 1)


@dataclass
class Yard:
    """A server with the grid 'yard' and its anomalies, ascending."""

    url: str
    starts: list[float]


@pytest.fixture(scope="module")
def yard(module_server: StartServer) -> Yard:
    """Two boxes were left, one after the other."""
    url = module_server(env={"TIDEMAP_UPDATER": "false"}).url
    last = make_grid(url, "yard", days=8)
    for hours, box in ((1, FLOOR[8:12]), (1.5, []), (20, FLOOR[20:22])):
        post(url, "/locations/yard/observations", {"observations": [look_around(last + timedelta(hours=hours), box)]})
    post(url, "/locations", {"name": "door", "kind": "state", "interval_s": 60})
    events = httpx.get(f"{url}/api/v1/locations/yard/anomalies", trust_env=False).json()["items"]
    return Yard(url, [datetime.fromisoformat(event["start"]).timestamp() for event in events])


def clock(page: Page) -> str:
    return page.locator("#date").inner_text() + " " + page.locator("#clock").inner_text()


def reach(viewer: Viewer, moment: float) -> None:
    """Wait until the scene shows a moment."""
    viewer.until(lambda: viewer.session()["time"] == moment)


def time_of(page: Page) -> Any:
    """The moment of the address; None where it follows the newest."""
    return page.evaluate("new URLSearchParams(location.search).get('time')")


def test_marks_are_clicked_where_they_are_drawn_and_land_on_their_moment(yard: Yard, page: Page) -> None:
    viewer = Viewer.open(page, yard.url, "yard", MORNING)
    page.get_by_role("button", name="All").click()
    line = page.locator(".timeline .covered").bounding_box()
    assert line is not None
    span = page.evaluate("[document.querySelector('#time').min, document.querySelector('#time').max].map(Number)")
    for start in yard.starts:
        x = 6 + (start - span[0]) / (span[1] - span[0]) * (line["width"] - 12)
        page.mouse.move(line["x"] + x, line["y"] + 6)
        expect(page.locator(".tip")).to_contain_text("occupied, expected free")
        page.mouse.click(line["x"] + x, line["y"] + 6)
        reach(viewer, start)
    page.mouse.move(line["x"] + line["width"] - 8, line["y"] + 20)
    expect(page.locator(".tip")).to_contain_text("forecast")


def test_where_there_is_no_later_anomaly_it_says_so(yard: Yard, page: Page) -> None:
    viewer = Viewer.open(page, yard.url, "yard", MORNING)
    for start in yard.starts:
        page.get_by_role("button", name="anomaly ›").click()
        reach(viewer, start)
    page.get_by_role("button", name="anomaly ›").click()
    expect(page.locator("#said")).to_have_text("There is no later anomaly.")
    assert float(time_of(page)) == yard.starts[-1]


def test_a_link_shows_all_that_was_chosen(yard: Yard, page: Page) -> None:
    chosen = (
        f"location=yard&time={MORNING.timestamp():.0f}&confidence=0.8&order=2&cell={cell(SHUT)}&floor=0.3"
        "&layout=overlay&predicted=verdict&zone=UTC&walls=coloured&slice=1-2&camera=4,-9,7,3,0,1"
    )
    page.goto(f"{yard.url}/view/?{chosen}&fixedDpr=1")
    viewer = Viewer(page, yard.url)
    viewer.until(lambda: viewer.session()["updates"] and viewer.session()["idle"])
    expect(page.locator("#confidence-value")).to_have_text("0.80")
    expect(page.locator("#order-value")).to_have_text("2")
    expect(page.locator("#slice-value")).to_have_text("0.50 – 1.50 m")
    expect(page.get_by_role("button", name="Overlay")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#selected-facts")).to_contain_text("[5, 0, 1]")
    expect(page.locator("#facts")).to_contain_text("order 2")
    expect(page.locator("#zone")).to_have_text("UTC")
    assert viewer.session()["predicted"] == sum(1 <= index[2] <= 2 for index in WALL) + 10
    assert viewer.session()["observed"] == 0
    page.keyboard.press(".")
    page.wait_for_url(f"**/view/?*time={MORNING.timestamp() + 1800:.0f}*")
    for each in chosen.split("&"):
        if not each.startswith(("time", "camera")):
            assert each in page.url
    assert "camera=4" in page.url


def test_back_is_undo_for_jumps_and_a_drag_is_one_of_them(yard: Yard, page: Page) -> None:
    viewer = Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    page.get_by_role("button", name="+1 h").click()
    page.get_by_role("button", name="+1 d").click()
    before = page.evaluate("history.length")
    page.evaluate(_DRAG, [MORNING.timestamp() + 60 * minutes for minutes in range(60, 90)])
    assert page.evaluate("history.length") == before + 1
    page.get_by_role("button", name="Overlay").click()
    viewer.until(lambda: viewer.session()["observed"] == 0)
    for expected in (MORNING.timestamp() + 89 * 60, MORNING.timestamp() + 25 * 3600, MORNING.timestamp() + 3600):
        page.go_back()
        reach(viewer, expected)
    expect(page.get_by_role("button", name="Beside")).to_have_attribute("aria-pressed", "true")
    viewer.until(lambda: viewer.session()["observed"] > 0)
    page.go_forward()
    reach(viewer, MORNING.timestamp() + 25 * 3600)


_DRAG = """times => {
  const slider = document.querySelector("#time");
  slider.dispatchEvent(new PointerEvent("pointerdown"));
  for (const time of times) {
    slider.value = time;
    slider.dispatchEvent(new Event("input"));
  }
  slider.dispatchEvent(new Event("change"));
}"""


def test_a_link_is_the_same_moment_in_every_zone(yard: Yard, page: Page) -> None:
    browser = page.context.browser
    assert browser is not None
    clocks = []
    for zone in ("Asia/Tokyo", "America/New_York"):
        with browser.new_context(timezone_id=zone) as context:
            there = context.new_page()
            there.goto(f"{yard.url}/view/?location=yard&time=2026-03-07T09:30:00%2B01:00")
            expect(there.locator("#zone")).to_have_text("Europe/London (GMT)")
            clocks.append(clock(there))
            there.get_by_label("Times in").select_option("mine")
            expect(there.locator("#zone")).to_contain_text(zone)
            there.wait_for_url("**zone=mine*")
            assert float(time_of(there)) == MORNING.timestamp()
            # A clock without a zone would be another moment for every reader.
            there.goto(f"{yard.url}/view/?location=yard&time=2026-03-07T09:30:00")
            expect(there.locator("#tense")).to_have_text("newest")
    assert clocks == ["Sat 7 Mar 2026 08:30:00"] * 2


def test_keys_move_the_time_after_a_click_in_the_scene_and_series_and_scene_share_cell_and_time(
    yard: Yard, page: Page
) -> None:
    viewer = Viewer.open(page, yard.url, "yard", MORNING)
    viewer.until(lambda: viewer.shows(color_of(yard.url, "yard", MORNING, SHUT), "left") > 200)
    x, y = viewer.pixel_of(SHUT)
    page.locator("#scene").click(position={"x": x, "y": y})
    expect(page.locator("#selected-facts")).to_contain_text("[5, 0, 1]")
    expect(page.locator("#selected-facts")).to_contain_text(", uncertain")  # p is about .8, and the confidence .9
    page.wait_for_url(f"**cell={cell(SHUT)}*")
    page.keyboard.press("ArrowRight")
    reach(viewer, MORNING.timestamp() + 3600)
    page.wait_for_function(_DRAWN, arg="uncertain")  # the strip has three states
    page.get_by_role("button", name="Day", exact=True).click()
    page.locator("#series").click(position={"x": 1, "y": 10})
    viewer.until(lambda: abs(float(str(viewer.session()["time"])) - datetime(2026, 3, 7).timestamp()) < 1800 * 2)
    page.go_back()
    reach(viewer, MORNING.timestamp() + 3600)


_DRAWN = """name => {
  const probe = document.createElement("i");
  probe.style.color = getComputedStyle(document.documentElement).getPropertyValue("--" + name);
  document.body.append(probe);
  const [r, g, b] = getComputedStyle(probe).color.match(/\\d+/g).map(Number);
  const canvas = document.querySelector("#series");
  const bytes = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  for (let i = 0; i < bytes.length; i += 4) if (bytes[i] === r && bytes[i + 1] === g && bytes[i + 2] === b) return true;
  return false;
}"""


def test_a_moment_is_typed_in_words_and_the_timeline_zooms(yard: Yard, page: Page) -> None:
    Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    for typed, expected in (
        ("10:30", "Sat 7 Mar 2026 10:30:00"),
        ("Thu 8:00", "Thu 5 Mar 2026 08:00:00"),
        ("+2 h", "Thu 5 Mar 2026 10:00:00"),
        ("8 Mar 9:15", "Sun 8 Mar 2026 09:15:00"),
        ("2026-03-06 07:00", "Fri 6 Mar 2026 07:00:00"),
    ):
        page.get_by_label("Go to a moment", exact=True).fill(typed)
        page.get_by_role("button", name="Go", exact=True).click()
        expect(page.locator(".when > div")).to_have_text(expected)
    page.get_by_label("Go to a moment", exact=True).fill("when it rained")
    page.get_by_role("button", name="Go", exact=True).click()
    expect(page.locator("#said")).to_contain_text("Not understood. Try: now")

    covered = "Number(document.querySelector('#time').max) - Number(document.querySelector('#time').min)"
    page.get_by_role("button", name="All").click()
    whole = page.evaluate(covered)
    page.locator(".timeline").hover()
    page.mouse.wheel(0, -1000)
    page.wait_for_function(f"({covered}) < {whole / 3}")
    page.locator("#time").focus()
    page.keyboard.press("-")
    page.keyboard.press("-")
    page.wait_for_function(f"({covered}) > {whole / 3}")


def test_a_location_that_is_deleted_while_it_is_viewed_goes(server: StartServer, page: Page) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false"})
    for name in ("shed", "yard"):
        make_grid(process.url, name, days=2)
    viewer = Viewer.open(page, process.url, "shed")
    httpx.delete(f"{process.url}/api/v1/locations/shed", trust_env=False).raise_for_status()
    expect(page.locator("#notice-title")).to_have_text("This location was deleted")
    expect(page.locator("#location option")).to_have_text(["yard"])
    page.locator("#location").select_option("yard")
    viewer.until(lambda: viewer.session()["location"] == "yard")
    expect(page.locator("#notice")).to_be_hidden()


def test_signing_out_in_another_tab_ends_the_viewer(server: StartServer, page: Page) -> None:
    process = server(env={"TIDEMAP_UPDATER": "false"})
    make_grid(process.url, "yard", days=2)
    key = make_key(("--data", str(process.data)), "operator")["key"]
    page.goto(f"{process.url}/login")
    page.get_by_label("Key").fill(key)
    page.get_by_role("button", name="Sign in").click()
    other = page.context.new_page()
    other.goto(f"{process.url}/view/?location=yard&cell=5")
    expect(other.locator("#tense")).to_have_text("newest")
    page.get_by_role("button", name="Sign out").click()
    expect(other.get_by_role("heading", level=1)).to_have_text("Sign in", timeout=1000 * (RECHECK_S + 20))
    assert "next=%2Fview%2F%3Flocation%3Dyard%26cell%3D5" in other.url


def test_a_state_has_no_scene_but_a_page(shared_server: ServerProcess) -> None:
    url = shared_server.url
    post(url, "/locations", {"name": "gate", "kind": "state", "interval_s": 60})
    answer = httpx.get(f"{url}/view/", params={"location": "gate"}, trust_env=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/locations/gate")


def test_a_sign_says_what_is_loaded_until_it_is_there(yard: Yard, page: Page) -> None:
    page.add_init_script(_NOTE_SIGNS)
    Viewer.open(page, yard.url, "yard", dim=True)
    expect(page.locator("#loading")).to_be_hidden()
    said = page.evaluate("window.signs")
    assert said[0] == "Connecting …"
    assert "Loading the 3D scene …" in said


_NOTE_SIGNS = """window.signs = [];
document.addEventListener("readystatechange", () => {
  const sign = document.querySelector("#loading-what");
  const note = () => window.signs.push(sign.textContent);
  if (sign && document.readyState === "interactive") new MutationObserver(note).observe(sign, { childList: true });
});"""


def test_the_viewer_keeps_nobody_out_and_complains_of_nothing(yard: Yard, page: Page) -> None:
    with no_complaints(page):
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            viewer = Viewer.open(page, yard.url, "yard", MORNING, dim=True)
            viewer.page.goto(f"{page.url}&cell={cell(SHUT)}")
            expect(page.locator("#selected-facts")).to_contain_text("[5, 0, 1]")
            assert barriers(page) == []
