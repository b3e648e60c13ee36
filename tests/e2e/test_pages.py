"""The pages for operators in a real browser on a real server."""

import re
from datetime import UTC, datetime, timedelta

import httpx
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.test_keys import make_key
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import make_grid, post

START = datetime(2026, 3, 2, tzinfo=UTC)
DAYS = 14


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


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> str:
    """The address of a server with a door and a grid."""
    make_door(shared_server.url, "office-door")
    make_grid(shared_server.url, "lab", days=8)
    return shared_server.url


def complaints(page: Page) -> list[str]:
    """What the browser complains about from now on, such as breaches of the content security policy."""
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    return said


def test_the_first_page_lists_the_locations(site: str, page: Page) -> None:
    said = complaints(page)
    page.goto(site)
    door = page.get_by_role("row", name="office-door")
    expect(door).to_contain_text("Mon 16 Mar 2026, 03:00:00 GMT")
    expect(door).to_contain_text("2,017")
    expect(door.locator("td[data-label='Open anomalies']")).to_have_text("1")
    expect(page.get_by_role("row", name="lab")).to_contain_text("3D grid · 10 × 6 × 4")
    page.get_by_role("link", name="office-door").click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("office-door")
    assert said == []


def test_the_list_refreshes_by_itself(server: StartServer, page: Page) -> None:
    process = server()
    page.goto(process.url)
    expect(page.get_by_role("heading", name="No locations yet")).to_be_visible()
    expect(page.locator("pre").first).to_contain_text(f"curl {process.url}/api/v1/locations")
    post(process.url, "/locations", {"name": "gate", "kind": "state", "interval_s": 60})
    expect(page.get_by_role("link", name="gate")).to_be_visible(timeout=15_000)


def test_the_example_for_an_empty_server_works_as_it_is_shown(server: StartServer, page: Page) -> None:
    process = server()
    page.goto(process.url)
    shown = page.locator("pre").first.inner_text()
    for path, body in re.findall(r"curl \S+(/api\S+) --json '(.*?)'", shown, re.DOTALL):
        answer = httpx.post(process.url + path, content=body, headers=_JSON, trust_env=False)
        assert answer.status_code == 201, answer.text


_JSON = {"Content-Type": "application/json"}


def test_a_door_has_a_chart_its_rhythms_and_anomalies(site: str, page: Page) -> None:
    said = complaints(page)
    page.goto(f"{site}/locations/office-door")
    canvas = page.locator("#chart canvas")
    expect(canvas).to_be_visible()
    expect(page.locator("#chart-note")).to_contain_text("Europe/London")
    expect(page.locator("#spectrum")).to_contain_text("24 h")
    expect(page.locator("#spectrum")).to_contain_text("highest at 12:55")
    expect(page.locator("#anomalies-table")).to_contain_text("occupied, expected free")

    page.locator("#chart .u-over").hover(position={"x": 400, "y": 100})
    expect(page.locator(".reading")).to_contain_text(re.compile(r"2026, \d\d:\d\d:\d\d .*p = [01]\.\d+ .*observed"))
    page.get_by_role("button", name="Day").click()
    expect(page.get_by_role("button", name="Day")).to_have_attribute("aria-pressed", "true")
    assert said == []


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


def test_an_operator_acknowledges_an_anomaly(server: StartServer, page: Page) -> None:
    process = server()
    make_door(process.url, "door")
    page.goto(f"{process.url}/locations/door")
    page.get_by_role("button", name="Acknowledge").click()
    expect(page.locator("#anomalies-table")).to_contain_text("anybody")
    expect(page.get_by_role("button", name="Acknowledge")).to_have_count(0)
    page.goto(process.url)
    expect(page.locator("td[data-label='Open anomalies']")).to_have_text("none")


def test_a_grid_shows_the_viewer_and_the_chart_of_a_cell(site: str, page: Page) -> None:
    page.goto(f"{site}/locations/lab")
    expect(page.locator("#chart")).to_contain_text("Choose a cell")
    viewer = page.frame_locator("iframe.viewer")
    expect(viewer.locator("#date")).to_have_text("Mon 9 Mar 2026")
    expect(viewer.locator("#location")).to_be_hidden()
    page.get_by_label("Cell").fill("121")
    page.get_by_role("button", name="Show").click()
    expect(page.locator("#chart canvas")).to_be_visible()
    expect(page.locator("#spectrum")).to_contain_text("24 h")
    assert page.url.endswith("?cell=121")
    page.get_by_label("Cell").fill("50")
    page.get_by_role("button", name="Show").click()
    expect(page.locator("#chart")).to_contain_text("Cell 50 has not been observed")
    expect(page.get_by_role("link", name="Open the viewer alone")).to_have_attribute("href", "/view/?location=lab")


def test_a_location_that_is_not_there_says_so(site: str, page: Page) -> None:
    answer = page.goto(f"{site}/locations/%3Cscript%3E")
    assert answer is not None
    assert answer.status == 404
    expect(page.get_by_role("heading", level=1)).to_have_text("Location not found")
    expect(page.locator("main")).to_contain_text("'<script>'")


@pytest.mark.parametrize("path", ["/", "/locations/office-door", "/locations/lab", "/view/?location=lab"])
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
    for address in re.findall(r'(?:src|href)="(/static/[^"]+)"', page.text):
        assert "?v=" in address
        assert httpx.get(site + address, trust_env=False).status_code == 200


def test_with_keys_one_signs_in_and_out(server: StartServer, page: Page) -> None:
    process = server()
    keys = {}
    for role in ("operator", "robot"):
        keys[role] = make_key(("--data", str(process.data)), role, "--name", f"a {role}")["key"]

    page.goto(f"{process.url}/?welcome=1")
    expect(page).to_have_url(f"{process.url}/login?next=%2F%3Fwelcome%3D1")
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
