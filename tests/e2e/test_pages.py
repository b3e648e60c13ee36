"""The pages for operators in a real browser on a real server."""

import base64
import io
import os
import re
import subprocess
from datetime import UTC, datetime
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.e2e.test_keys import make_key
from tests.support.pages import PAGES, START, VIEWER, barriers, loading, make_door, no_complaints, quiet_afterwards
from tests.support.paths import ROOT
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import make_grid, post
from tests.support.waiting import until

DAY_S = 86400


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> str:
    """The address of a server with a door and a grid."""
    make_door(shared_server.url, "office-door")
    make_grid(shared_server.url, "lab", days=8)
    return shared_server.url


def test_the_first_page_lists_the_locations(site: str, page: Page) -> None:
    with no_complaints(page):
        page.goto(site)
        door = page.get_by_role("row", name="office-door")
        expect(door.locator("td[data-label='Now'] small")).to_have_text(re.compile(r"p = [01]\.\d\d"))
        expect(door.locator("td[data-label='Next change']")).to_have_text(
            re.compile(r"(free|occupied) about .*\d\d:\d\d")
        )
        expect(door.locator("svg.spark path").first).to_have_attribute("d", re.compile("^M0 "))
        expect(door.locator(".seen time")).to_have_text(re.compile("ago"))
        expect(door.locator("td[data-label='Anomalies']")).to_have_text("1 open")
        expect(page.get_by_role("row", name="lab")).to_contain_text("3D grid · 10 × 6 × 4")
        page.get_by_role("link", name="office-door").click()
        expect(page.get_by_role("heading", level=1)).to_contain_text("office-door")


def test_the_list_refreshes_by_itself(server: StartServer, page: Page) -> None:
    process = server()
    page.goto(process.url)
    expect(page.get_by_role("heading", name="No locations yet")).to_be_visible()
    assert barriers(page) == []
    expect(page.locator("pre").first).to_contain_text(f"curl {process.url}/api/v1/locations")
    post(process.url, "/locations", {"name": "gate", "kind": "state", "interval_s": 60})
    expect(page.get_by_role("link", name="gate")).to_be_visible(timeout=15_000)


@pytest.mark.parametrize("keyed", [False, True], ids=["open", "keyed"])
def test_the_example_for_an_empty_server_works_as_it_is_shown(server: StartServer, page: Page, keyed: bool) -> None:
    process = server()
    page.goto(process.url)
    key = ""
    if keyed:
        key = make_key(("--data", str(process.data)), "admin")["key"]
        page.goto(process.url)
        page.get_by_label("Key").fill(key)
        page.get_by_role("button", name="Sign in").click()
    shown = page.locator("pre").first.inner_text()
    assert ("Authorization: Bearer" in shown) is keyed
    done = subprocess.run(
        ["sh", "-ec", shown], env={**os.environ, "TIDEMAP_KEY": key, "NO_PROXY": "*"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert '"accepted":2' in done.stdout.replace(" ", "")


def test_a_door_has_a_chart_its_rhythms_and_anomalies(site: str, page: Page) -> None:
    with no_complaints(page):
        page.goto(f"{site}/locations/office-door")
        expect(page.locator("#chart canvas")).to_be_visible()
        expect(page.locator("#chart-note")).to_contain_text("Europe/London")
        expect(page.locator("#spectrum")).to_contain_text("24 h")
        expect(page.locator("#spectrum")).to_contain_text("highest at 12:55")
        expect(page.locator("#spectrum svg")).to_contain_text("12 h")
        expect(page.locator("#spectrum svg")).to_contain_text("7 d")
        expect(page.locator("#anomalies-table")).to_contain_text("occupied, expected free")
        expect(page.locator("#facts")).to_contain_text("Measurements")
        expect(page.locator("#facts")).to_contain_text("in-sample")
        page.locator("#chart .u-over").hover(position={"x": 400, "y": 100})
        expect(page.locator(".reading")).to_contain_text(re.compile(r"2026, \d\d:\d\d:\d\d .*p = [01]\.\d+ .*observed"))
        page.get_by_role("button", name="Day").click()
        expect(page.get_by_role("button", name="Day")).to_have_attribute("aria-pressed", "true")


def test_the_hours_of_a_week_are_mapped_as_expected_and_as_observed(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/office-door")
    expected, observed = (page.locator(".week").nth(i) for i in range(2))
    assert "occupied 100 % of the time, " in (observed.locator("td.known").nth(24 + 12).get_attribute("title") or "")
    assert (observed.locator("td.known").nth(24 + 22).get_attribute("title") or "").startswith(
        "Tue 22:00: occupied 0 %"
    )
    noon = expected.locator("td.known").nth(24 + 12).get_attribute("title") or ""
    assert noon.startswith("Tue 12:00: occupied ")
    assert int(noon.split()[3]) > 90


def test_the_range_of_the_chart_is_drawn_in_the_strip_of_the_whole_history(site: str, page: Page) -> None:
    # What loads above the strip moves it.
    with quiet_afterwards(page):
        page.goto(f"{site}/locations/office-door?time={(datetime(2026, 3, 5, 12, tzinfo=UTC)).timestamp()}")
    strip = page.locator("#history .brush .u-over")
    expect(page.locator("#history .brush .u-select")).to_be_visible()
    expect(page.get_by_role("button", name="Week")).to_have_attribute("aria-pressed", "false")
    box = until(strip.bounding_box)
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 8)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 8, steps=4)
    with page.expect_request(re.compile("/series")) as asked:
        page.mouse.up()
    query = parse_qs(urlsplit(asked.value.url).query)
    days = (float(query["stop"][0]) - float(query["start"][0])) / 86400
    assert 3 < days < 5  # a quarter of fifteen days and a half


def test_how_well_it_is_predicted_is_shown_when_asked(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/office-door")
    page.get_by_role("button", name="Evaluate").click()
    expect(page.locator("#evaluation")).to_contain_text("Best on later time: ", timeout=60_000)
    expect(page.locator("#evaluation figure")).to_have_count(3)
    expect(page.locator("#evaluation tbody tr")).to_have_count(3)
    expect(page.locator("#model-card")).to_contain_text("which says less")


def test_an_update_is_asked_for_and_comes_to_its_end(server: StartServer, page: Page) -> None:
    process = server()
    make_door(process.url, "door")
    wrong = {"time": [START.timestamp()], "state": [7]}
    address = f"{process.url}/api/v1/locations/door/observations?source=rover"
    assert httpx.post(address, json=wrong, trust_env=False).status_code == 422
    page.goto(f"{process.url}/locations/door")
    page.get_by_role("button", name="Update now").click()
    expect(page.locator("#work")).to_contain_text("revision 2", timeout=60_000)
    expect(page.locator("#work")).to_contain_text("without a name")
    expect(page.get_by_role("row", name="rover").locator("td[data-label='Refused']")).to_contain_text(
        re.compile(r"^\s*1 since .*state\[0\]", re.DOTALL)
    )
    expect(page.locator("#history .legend")).to_contain_text("by revision 2", timeout=60_000)
    page.get_by_label("Confidence").fill("0.2")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#settings-form output")).to_contain_text("confidence: ")
    page.get_by_label("Confidence").fill("0.95")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#facts")).to_contain_text("0.95")


def test_the_chart_shows_what_was_predicted_and_observed(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/office-door")
    expect(page.locator("#chart canvas")).to_be_visible()
    for name in ("predicted", "occupied", "anomaly"):
        color = page.evaluate(_COLOUR, name)
        page.wait_for_function(_PAINTED, arg=color)


_COLOUR = """name => {
  const probe = document.createElement("i");
  probe.style.color = getComputedStyle(document.documentElement).getPropertyValue("--" + name);
  document.body.append(probe);
  return getComputedStyle(probe).color.match(/\\d+/g).map(Number);
}"""
_PAINTED = """color => {
  const canvas = document.querySelector("#chart canvas");
  const bytes = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < bytes.length; i += 4)
    count += bytes[i] === color[0] && bytes[i + 1] === color[1] && bytes[i + 2] === color[2];
  return count > 20;
}"""


def test_an_operator_acknowledges_one_and_several_with_a_note(server: StartServer, page: Page) -> None:
    process = server()
    for name in ("door", "gate", "hatch"):
        make_door(process.url, name)
    page.goto(f"{process.url}/locations/door")
    page.locator("#anomalies-table").get_by_role("button", name="Acknowledge").click()
    expect(page.locator("#anomalies-table")).to_contain_text("anybody")
    page.goto(f"{process.url}/anomalies")
    expect(page.locator("#anomalies-table tbody tr")).to_have_count(2)
    page.get_by_label("Note").fill("the cleaners")
    page.get_by_role("button", name="Choose all").click()
    page.get_by_role("button", name="Acknowledge 2 chosen").click()
    expect(page.locator("#anomalies-table tbody tr")).to_have_count(0)
    page.get_by_label("Show").select_option("acknowledged")
    expect(page.locator("#anomalies-table tbody tr")).to_have_count(3)
    expect(page.locator("#anomalies-table")).to_contain_text("the cleaners")
    page.get_by_role("searchbox").fill("gat")
    expect(page.locator("#anomalies-table tbody tr")).to_have_count(1)
    page.locator("#anomalies-table th a").click()
    expect(page).to_have_url(re.compile("/locations/gate\\?time=1773630000"))
    page.goto(process.url)
    expect(page.locator("td[data-label='Anomalies']").first).to_have_text("none")


def test_a_grid_shows_the_viewer_and_the_chart_of_a_cell(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/lab?cell=abc")
    expect(page.locator("#chart")).to_contain_text("Choose a cell")
    viewer = page.frame_locator("iframe.viewer")
    expect(viewer.locator("#date")).to_have_text("Mon 9 Mar 2026")
    expect(viewer.locator("#location")).to_be_hidden()
    page.get_by_label("Cell", exact=True).fill("121")
    page.get_by_role("button", name="Show").click()
    expect(page.locator("#chart canvas")).to_be_visible()
    expect(page.locator("#spectrum")).to_contain_text("24 h")
    assert page.url.endswith("?cell=121")
    expect(viewer.locator("#selected-facts")).to_contain_text("[5, 0, 1]")
    page.get_by_label("Cell", exact=True).fill("50")
    page.get_by_role("button", name="Show").click()
    expect(page.locator("#chart")).to_contain_text("Cell 50 has not been observed")
    page.goto(f"{site}/locations/lab?cell=121&time=2026-03-05T10:00:00Z")
    expect(viewer.locator("#date")).to_have_text("Thu 5 Mar 2026")
    expect(viewer.locator("#clock")).to_have_text("10:00:00")
    alone = "/view/?location=lab&cell=121&time=1772704800"
    expect(page.get_by_role("link", name="Open the viewer alone")).to_have_attribute("href", alone)


def test_a_page_and_its_viewer_show_one_cell_one_moment_and_one_range(site: str, page: Page) -> None:
    moment = int(datetime(2026, 3, 5, 10, tzinfo=UTC).timestamp())
    last = int(datetime(2026, 3, 9, 23, 30, tzinfo=UTC).timestamp())
    page.goto(f"{site}/locations/lab?cell=121&time={moment}")
    viewer = page.frame_locator("iframe.viewer")
    expect(viewer.locator("#clock")).to_have_text("10:00:00", timeout=30_000)
    slider = viewer.locator("#time")
    expect(slider).to_have_attribute("min", str(moment - DAY_S // 2))
    viewer.get_by_role("button", name="+1 h").click()
    expect(page).to_have_url(re.compile(f"time={moment + 3600}$"))

    with quiet_afterwards(page):
        page.get_by_role("button", name="Day").click()
    expect(slider).to_have_attribute("min", str(last - DAY_S))
    expect(slider).to_have_attribute("max", str(last + DAY_S))
    plot = page.locator("#chart .u-over")
    # A chart that is drawn anew has no box for a moment.
    box = until(plot.bounding_box)
    plot.click(position={"x": box["width"] / 4, "y": 40})
    expect(viewer.locator("#date")).to_have_text("Mon 9 Mar 2026")
    chosen = float(parse_qs(urlsplit(page.url).query)["time"][0])
    assert abs(chosen - (last - DAY_S / 2)) < 2 * DAY_S / box["width"]
    page.go_back()
    expect(viewer.locator("#clock")).to_have_text("11:00:00")
    expect(page).to_have_url(re.compile(f"time={moment + 3600}$"))


def test_an_anomaly_of_a_page_leads_to_its_moment_there(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/office-door")
    page.locator("#anomalies-table th a").click()
    expect(page).to_have_url(re.compile("/locations/office-door\\?time=1773630000$"))
    expect(page.locator("#history")).to_be_in_viewport()
    page.go_back()
    expect(page).to_have_url(re.compile("/locations/office-door$"))


def test_older_anomalies_are_those_of_that_location_alone(site: str, page: Page) -> None:
    page.goto(f"{site}/anomalies?of=office-door&state=all")
    expect(page.get_by_role("heading", level=1)).to_have_text("Anomalies of office-door")
    expect(page.locator("#anomalies-table tbody tr")).to_have_count(1)
    page.get_by_label("Surprise").select_option("0.9")
    expect(page).to_have_url(re.compile("of=office-door"))
    for name, status in (("office", 404), ("office-door", 200)):
        assert httpx.get(f"{site}/anomalies?of={name}", trust_env=False).status_code == status


def test_the_api_is_documented_and_tried_on_its_page(site: str, page: Page) -> None:
    page.goto(f"{site}/api/docs#predict")
    paths = httpx.get(f"{site}/api/v1/openapi.json", trust_env=False).json()["paths"]
    expect(page.locator("form.try")).to_have_count(sum(map(len, paths.values())))
    form = page.locator("#predict form.try")
    expect(form).to_be_visible()
    form.get_by_label("name").fill("office-door")
    form.get_by_label("Body").fill('{"time": [1772528400]}')
    form.get_by_role("button").click()
    expect(form.locator("output")).to_contain_text("200 OK")
    expect(form.locator("output")).to_contain_text('"probability"')
    shown = form.get_by_label("Request").inner_text()
    done = subprocess.run(["sh", "-ec", shown], env={**os.environ, "NO_PROXY": "*"}, capture_output=True, text=True)
    assert '"probability"' in done.stdout, done.stderr


def test_a_location_that_is_not_there_says_so(site: str, page: Page) -> None:
    answer = page.goto(f"{site}/locations/%3Cscript%3E")
    assert answer is not None
    assert answer.status == 404
    expect(page.get_by_role("heading", level=1)).to_have_text("Location not found")
    expect(page.locator("main")).to_contain_text("'<script>'")


@pytest.mark.parametrize(
    "path", ["/", "/anomalies", "/new", "/locations/office-door", "/locations/lab", "/view/?location=lab"]
)
def test_a_phone_needs_no_sideways_scrolling(site: str, page: Page, path: str) -> None:
    page.set_viewport_size({"width": 360, "height": 740})
    page.goto(site + path)
    page.wait_for_load_state("load")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_pages_carry_strict_headers_and_lasting_assets(site: str) -> None:
    page = httpx.get(site, trust_env=False)
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert page.headers["x-content-type-options"] == "nosniff"
    assert page.headers["cache-control"] == "no-store"
    assert not re.findall(r"(?:src|href)=\"https?://", page.text)
    addresses = re.findall(r'(?:src|href)="(/static/[^"]+)"', page.text)
    assert len(addresses) > 3
    for address in addresses:
        answer = httpx.get(site + address, trust_env=False)
        assert answer.status_code == 200
        assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
        if not address.endswith(".svg"):
            assert answer.headers["content-encoding"] == "gzip"
    before = re.sub(r"/static/\w+/", "/static/another/", addresses[-1])
    assert httpx.get(site + before, trust_env=False).headers["cache-control"] == "no-cache"


def test_an_address_that_is_not_there_answers_people_with_a_page(site: str) -> None:
    for headers, media_type in (({"Accept": "text/html,*/*"}, "text/html"), ({}, "application/problem+json")):
        answer = httpx.get(f"{site}/nowhere", headers=headers, trust_env=False)
        assert (answer.status_code, answer.headers["content-type"].split(";")[0]) == (404, media_type)
    answer = httpx.get(f"{site}/api/v1/nowhere", headers={"Accept": "text/html"}, trust_env=False)
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("path", PAGES)
def test_pages_are_light_keep_nobody_out_and_hold_still(site: str, page: Page, path: str) -> None:
    page.add_init_script(_WATCH_SHIFTS)
    with no_complaints(page, "404" if path == "/nowhere" else None), loading(page) as load:
        page.goto(site + path)
    assert all(address.startswith((site, "data:", "blob:")) for address in load.asked)
    most, n_bytes = WEIGHTS[path]
    asked = [each for each in load.asked if each.startswith(site) and VIEWER not in each]
    assert len(asked) <= most
    assert 0.7 * n_bytes < load.n_bytes <= n_bytes, "docs/viewer.md says what a page weighs"
    assert page.evaluate("window.shifted") <= 0.05
    if path.startswith("/view"):
        return  # what is in the scene's frame is viser's; the panel is looked at in test_viewer_hands.py
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        assert barriers(page) == []


def weights() -> dict[str, tuple[int, int]]:
    """The table of docs/viewer.md: by path, how often a page asks at most, and how many bytes come at most."""
    text = (ROOT / "docs" / "viewer.md").read_text()
    rows = re.findall(r"^\| `(/.*?)` \| (\d+) \| (\d+) kB \|", text, re.MULTILINE)
    return {path: (int(most), 1000 * int(kb)) for path, most, kb in rows}


WEIGHTS = weights()
_WATCH_SHIFTS = """
window.shifted = 0;
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) if (!entry.hadRecentInput) window.shifted += entry.value;
}).observe({ type: "layout-shift", buffered: true });
"""


def test_with_keys_one_signs_in_and_out(server: StartServer, page: Page) -> None:
    process = server()
    keys = {}
    for role in ("operator", "robot"):
        keys[role] = make_key(("--data", str(process.data)), role, "--name", f"a {role}")["key"]

    page.goto(f"{process.url}/?welcome=1")
    expect(page).to_have_url(f"{process.url}/login?next=%2F%3Fwelcome%3D1")
    assert barriers(page) == []
    for wrong, problem in (("tm_wrong", "not known here"), (keys["robot"], "robot's key")):
        page.get_by_label("Key").fill(wrong)
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("alert")).to_contain_text(problem)
    page.get_by_label("Key").fill(keys["operator"])
    page.get_by_role("button", name="Sign in").click()
    expect(page).to_have_url(f"{process.url}/?welcome=1")
    expect(page.locator(".who")).to_contain_text("a operator")
    (cookie,) = page.context.cookies()
    assert (cookie["name"], cookie["httpOnly"], cookie["sameSite"]) == ("tidemap_session", True, "Strict")

    page.goto(f"{process.url}/view/")
    expect(page.locator("#notice-title")).to_have_text("No grid yet")  # its socket was let in
    page.goto(process.url)
    page.get_by_role("button", name="Sign out").click()
    page.goto(process.url)
    expect(page.get_by_role("heading", level=1)).to_have_text("Sign in")


def test_a_session_that_ended_leads_to_the_sign_in_page(server: StartServer, page: Page) -> None:
    process = server()
    page.goto(process.url)
    expect(page.get_by_role("heading", name="No locations yet")).to_be_visible()
    make_key(("--data", str(process.data)), "operator")
    expect(page.get_by_role("heading", level=1)).to_have_text("Sign in", timeout=15_000)


def test_the_rhythms_bars_are_wide_enough_for_a_phone(site: str, page: Page) -> None:
    page.set_viewport_size({"width": 360, "height": 740})
    page.goto(f"{site}/locations/office-door")
    box = page.locator(".meter").first.bounding_box()
    assert box is not None
    assert box["width"] > 200


def test_a_scene_is_never_white_while_it_loads(site: str, page: Page) -> None:
    page.emulate_media(color_scheme="dark")
    page.goto(f"{site}/nowhere")  # an empty tab is white
    frames: list[str] = []
    session = page.context.new_cdp_session(page)

    def keep(frame: dict[str, Any]) -> None:
        frames.append(frame["data"])
        session.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    session.on("Page.screencastFrame", keep)
    session.send("Page.startScreencast", {"format": "png"})
    page.goto(f"{site}/view/?location=lab")
    expect(page.locator("#date")).to_have_text(re.compile("2026"), timeout=60_000)
    page.frame_locator("#scene").locator("canvas").first.wait_for()
    page.wait_for_timeout(1000)
    assert frames
    for frame in frames:
        shown = Image.open(io.BytesIO(base64.b64decode(frame))).convert("L").crop((0, 60, 1000, 500))
        assert sum(shown.histogram()[200:]) < shown.width * shown.height / 20
