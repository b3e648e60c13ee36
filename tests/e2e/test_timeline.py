"""The timeline's strips, brush, loop and keys, and what is taken along, in a real browser."""

import csv
import io
import re
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Download, Page, expect

from tests.support.pages import barriers, make_door, no_complaints
from tests.support.server import StartServer
from tests.support.viewer import FLOOR, START, Viewer, cell, color_of, look_around, make_grid, post

WEEKS_D = 24
SHUT = (5, 0, 1)
MORNING = START + timedelta(days=5, hours=9)
LONG_MS = 90_000
MARGIN_PX = 6


@dataclass
class Yard:
    """A server with the grid 'yard', whose last look was at `last`, and 'door'."""

    url: str
    last: datetime


@pytest.fixture(scope="module")
def yard(module_server: StartServer) -> Yard:
    """Seen every half hour for weeks; then nothing for a day, and one look with a box on the floor."""
    url = module_server(env={"TIDEMAP_UPDATER": "false"}).url
    last = make_grid(url, "yard", days=WEEKS_D) + timedelta(days=1)
    post(url, "/locations/yard/observations", {"observations": [look_around(last, FLOOR[8:12])]})
    make_door(url, "door")
    return Yard(url, last)


def covered(page: Page) -> tuple[float, float]:
    low, high = page.evaluate("['min', 'max'].map((end) => Number(document.querySelector('#time')[end]))")
    return low, high


def x_of(page: Page, moment: datetime, span: tuple[float, float]) -> float:
    """Where a moment is on a strip that shows a stretch."""
    box = page.locator(".timeline .whole").bounding_box()
    assert box is not None
    share = (moment.timestamp() - span[0]) / (span[1] - span[0])
    return float(box["x"] + MARGIN_PX + share * (box["width"] - 2 * MARGIN_PX))


def whole_of(yard: Yard, page: Page) -> tuple[tuple[float, float], float]:
    """All that the strip of all shows, and the height of its middle on the page."""
    page.get_by_role("button", name="All").click()
    box = page.locator(".timeline .whole").bounding_box()
    assert box is not None
    return covered(page), box["y"] + box["height"] / 2


def drag(page: Page, start: tuple[float, float], stop: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move((start[0] + stop[0]) / 2, stop[1])
    page.mouse.move(*stop)
    page.mouse.up()


def test_a_stretch_is_drawn_moved_and_resized_on_the_strip_of_all(yard: Yard, page: Page) -> None:
    Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    span, y = whole_of(yard, page)
    pixel_s = (span[1] - span[0]) / 1000
    wanted = [START + timedelta(days=3), START + timedelta(days=8)]
    drag(page, (x_of(page, wanted[0], span), y), (x_of(page, wanted[1], span), y))
    assert covered(page) == pytest.approx([each.timestamp() for each in wanted], abs=2 * pixel_s)
    middle = x_of(page, START + timedelta(days=5), span)
    drag(page, (middle, y), (middle + 100, y))
    low, high = covered(page)
    assert high - low == pytest.approx(5 * 86400, abs=2 * pixel_s)
    assert low > wanted[0].timestamp() + 50 * pixel_s
    edge = x_of(page, datetime.fromtimestamp(high, START.tzinfo), span)
    drag(page, (edge, y), (edge + 60, y))
    assert covered(page)[0] == pytest.approx(low, abs=1)
    assert covered(page)[1] > high + 30 * pixel_s
    page.keyboard.press("PageUp")
    assert covered(page)[0] < low
    page.mouse.dblclick(middle, y)
    assert covered(page) == span


def test_the_strip_shows_how_much_was_observed_and_says_so_under_the_pointer(yard: Yard, page: Page) -> None:
    Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    span, y = whole_of(yard, page)
    page.wait_for_function(_TALL, arg=".timeline .whole")
    bars = page.evaluate(f"({_TALL})('.timeline .whole')")
    seen, gap = MORNING + timedelta(days=3), yard.last - timedelta(hours=12)
    at = [(moment.timestamp() - span[0]) / (span[1] - span[0]) for moment in (seen, gap)]
    assert [bars[round(share * (len(bars) - 1))] > 10 for share in at] == [True, False]
    page.mouse.move(x_of(page, seen, span), y)
    expect(page.locator(".tip")).to_contain_text("measurements in")
    page.mouse.move(x_of(page, gap, span), y)
    expect(page.locator(".tip")).to_contain_text("nothing observed")
    with page.expect_response("**/density?*"):
        page.get_by_role("button", name="Day", exact=True).click()
    page.mouse.move(x_of(page, seen, span), y)
    expect(page.locator(".tip")).to_contain_text("measurements in")


def test_the_pointer_says_how_much_was_observed_as_soon_as_that_is_known(yard: Yard, page: Page) -> None:
    page.route("**/density?*", lambda route: route.abort())
    viewer = Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    span, y = whole_of(yard, page)
    page.mouse.move(x_of(page, MORNING + timedelta(days=3), span), y)
    expect(page.locator(".tip")).to_have_text(re.compile(r"^Tue 10 Mar, \d\d:\d\d:\d\d$"))
    page.unroute("**/density?*")

    def said() -> bool:
        page.keyboard.press("PageUp")  # What failed is asked again, once it is known to have failed.
        return "measurements in" in page.locator(".tip").inner_text()

    viewer.until(said)


# How many pixels of each column have the colour of what was observed.
_TALL = """selector => {
  const probe = document.createElement("i");
  probe.style.color = getComputedStyle(document.documentElement).getPropertyValue("--seen");
  document.body.append(probe);
  const [r, g, b] = getComputedStyle(probe).color.match(/\\d+/g).map(Number);
  probe.remove();
  const canvas = document.querySelector(selector);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const counts = Array.from({ length: canvas.width - 12 }, () => 0);
  for (let i = 0; i < data.length; i += 4) {
    const column = (i / 4) % canvas.width - 6;
    if (data[i] === r && data[i + 1] === g && data[i + 2] === b && column in counts) counts[column] += 1;
  }
  return counts.some((count) => count > 10) && counts;
}"""


def loop_of(url: str) -> float:
    """How long the loop of an address is, 0 without one."""
    start, _, stop = parse_qs(urlsplit(url).query).get("loop", ["0,0"])[0].partition(",")
    return float(stop) - float(start)


def test_playing_goes_round_in_a_loop_that_is_drawn_or_set_by_keys_and_is_in_the_link(yard: Yard, page: Page) -> None:
    viewer = Viewer.open(page, yard.url, "yard", MORNING, dim=True)
    page.get_by_role("button", name="Day", exact=True).click()
    line = page.locator(".timeline .covered").bounding_box()
    assert line is not None
    page.keyboard.down("Shift")
    drag(page, (line["x"] + 300, line["y"] + 22), (line["x"] + 500, line["y"] + 22))
    page.keyboard.up("Shift")
    expect(page.get_by_role("button", name="Loop", pressed=True)).to_be_visible()
    length = pytest.approx(86400 * 200 / (line["width"] - 2 * MARGIN_PX), rel=0.02)
    page.wait_for_url(lambda url: loop_of(url) == length)

    page.keyboard.press("\\")
    page.wait_for_url(lambda url: "loop" not in url)
    page.keyboard.press("[")
    for _ in range(2):
        page.keyboard.press(".")
    page.keyboard.press("]")
    start = MORNING.timestamp()
    page.wait_for_url(f"**loop={start:.0f}%2C{start + 3600:.0f}*")
    page.locator("#speed").select_option("5 samples")
    page.keyboard.press("<")
    assert page.locator("#speed").input_value() == "3600"  # two samples of half an hour
    page.evaluate(_NOTE_TIMES)
    page.locator("#play").click()
    page.wait_for_function("() => window.times.filter((each, i) => i && each < window.times[i - 1]).length >= 2")
    page.locator("#play").click()
    times = page.evaluate("window.times")
    assert min(times[1:]) >= start
    assert max(times) <= start + 3600
    assert viewer.session()["location"] == "yard"

    page.goto(f"{yard.url}/view/?location=yard&time={start:.0f}&loop={start:.0f},{start + 7200:.0f}")
    expect(page.get_by_role("button", name="Loop", pressed=True)).to_be_visible()


_NOTE_TIMES = """() => {
  window.times = [];
  const slider = document.querySelector("#time");
  const note = () => {
    if (window.times.at(-1) !== Number(slider.value)) window.times.push(Number(slider.value));
    requestAnimationFrame(note);
  };
  note();
}"""


def image_of(file: Path) -> Any:
    return Image.open(io.BytesIO(file.read_bytes()))


def taken(page: Page, button: Any, folder: Path) -> Path:
    """The file that a button gives."""
    with page.expect_download(timeout=LONG_MS) as found:
        button.click()
    download: Download = found.value
    path = folder / download.suggested_filename
    download.save_as(path)
    return path


def test_a_picture_has_the_scene_and_a_film_every_sample_of_the_loop(yard: Yard, page: Page, tmp_path: Path) -> None:
    start = MORNING.timestamp()
    page.goto(f"{yard.url}/view/?location=yard&time={start:.0f}&loop={start:.0f},{start + 5400:.0f}&fixedDpr=1")
    viewer = Viewer(page, yard.url)
    page.get_by_label("Grey what is always occupied").uncheck()
    colour = color_of(yard.url, "yard", MORNING, SHUT)
    viewer.until(lambda: viewer.shows(colour, "left") > 200)
    with no_complaints(page):
        picture = taken(page, page.get_by_role("button", name="Picture"), tmp_path)
        assert picture.name == "yard-2026-03-07-09-00.png"
        pixels = np.asarray(image_of(picture).convert("RGB"))
        scene = page.locator("#scene").bounding_box()
        assert scene is not None
        assert pixels.shape[1] == round(scene["width"])
        assert pixels.shape[0] > scene["height"] + 60
        assert int((pixels == np.array(colour, np.uint8)).all(axis=2).sum()) > 200
        film = image_of(taken(page, page.locator("#take-loop"), tmp_path))
    assert (film.format, film.n_frames) == ("WEBP", 3)
    expect(page.locator("#take-loop")).to_have_text("Loop")
    page.wait_for_url(f"**time={start:.0f}*")


def test_the_series_of_a_cell_is_a_table(yard: Yard, page: Page, tmp_path: Path) -> None:
    start = MORNING.timestamp()
    page.goto(f"{yard.url}/view/?location=yard&time={start:.0f}&cell={cell(SHUT)}")
    expect(page.locator("#selected-facts")).to_contain_text("[5, 0, 1]")
    page.get_by_role("button", name="Day", exact=True).click()
    table = taken(page, page.get_by_role("button", name="Table"), tmp_path)
    assert table.name == f"yard-{cell(SHUT)}.csv"
    rows = list(csv.DictReader(io.StringIO(table.read_text())))
    low, high = covered(page)
    assert [float(row["time_s"]) for row in rows] == np.arange(low, high, 1800).tolist()
    assert {row["time_zone"] for row in rows} == {"Europe/London"}
    assert [row["observed"] for row in rows] == [str(int(8 <= i / 2 < 18)) for i in range(48)]


def test_a_locations_page_gives_its_chart_and_its_series_along(yard: Yard, page: Page, tmp_path: Path) -> None:
    page.goto(f"{yard.url}/locations/door")
    expect(page.locator("#chart canvas")).to_be_visible()
    picture = image_of(taken(page, page.get_by_role("button", name="Picture"), tmp_path))
    box = page.locator("#chart canvas").bounding_box()
    assert box is not None
    assert picture.size[0] == round(box["width"])
    assert picture.size[1] > box["height"] + 60
    rows = list(
        csv.DictReader(io.StringIO(taken(page, page.get_by_role("button", name="Table"), tmp_path).read_text()))
    )
    assert float(rows[1]["time_s"]) - float(rows[0]["time_s"]) == 600
    assert any(row["observed"] == "1" for row in rows)
    page.get_by_role("link", name="Report").click()
    page.wait_for_url("**/locations/door/report?start=*&stop=*")


def test_a_report_prints_all_of_a_period_on_paper(yard: Yard, page: Page, tmp_path: Path) -> None:
    start, stop = START.timestamp(), (START + timedelta(days=16)).timestamp()
    with no_complaints(page):
        page.emulate_media(color_scheme="dark")
        page.goto(f"{yard.url}/locations/door/report?start={start:.0f}&stop={stop:.0f}")
        expect(page.get_by_role("button", name="Print")).to_be_enabled(timeout=LONG_MS)
        expect(page.locator("#period svg .curve")).to_have_count(1)
        expect(page.locator("#week table")).to_have_count(2)
        expect(page.locator(".events tbody tr")).to_have_count(1)
        expect(page.locator(".events")).to_contain_text("Mon 16 Mar 2026, 03:00:00 GMT")
        expect(page.locator("#model-card")).to_contain_text("Revision 1")
        expect(page.locator("#evaluation [data-answer]")).to_contain_text(re.compile("Learning|Best on later time"))
        assert barriers(page) == []
        paper = page.evaluate("getComputedStyle(document.querySelector('main')).backgroundColor")
        assert paper == "rgb(255, 255, 255)"
        page.emulate_media(media="print")
        for hidden in (".bar", ".tools", "footer"):
            expect(page.locator(hidden).first).to_be_hidden()
        assert page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") <= 3
    page.emulate_media(media="screen")
    page.get_by_role("link", name="earlier").click()
    page.wait_for_url(f"**start={start - (stop - start):.0f}&stop={start:.0f}")
    expect(page.locator("#report")).to_contain_text("None.")


@pytest.mark.parametrize("query", ["", "?cell=999999", "?cell=x&start=never", f"?cell={cell(SHUT)}"])
def test_a_grid_has_a_report_too_with_a_cell_or_without(yard: Yard, query: str) -> None:
    answer = httpx.get(f"{yard.url}/locations/yard/report{query}", trust_env=False)
    assert answer.status_code == 200
    assert ("This is a report of the whole grid" in answer.text) == (f"cell={cell(SHUT)}" not in query)
    assert httpx.get(f"{yard.url}/locations/nowhere/report", trust_env=False).status_code == 404
