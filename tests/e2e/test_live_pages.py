"""Pages while things happen: the server goes and comes back, a location is deleted, somebody signs out."""

import re
import time

import httpx
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from tests.e2e.test_keys import make_key
from tests.support.pages import make_door
from tests.support.server import ServerProcess, StartServer
from tests.support.viewer import post

WAIT_MS = 60_000


def make_location(url: str, name: str, states: list[int]) -> None:
    """A location whose readings are of just now."""
    post(url, "/locations", {"name": name, "kind": "state", "interval_s": 1})
    now = time.time()
    post(
        url,
        f"/locations/{name}/observations",
        {"time": [now - len(states) + i for i in range(len(states))], "state": states},
    )


def test_a_dead_server_is_seen_and_its_pages_recover_by_themselves(server: StartServer, page: Page) -> None:
    process = server()
    make_door(process.url, "door")
    make_location(process.url, "gate", [0, 1])
    other = page.context.new_page()
    page.goto(process.url)
    other.goto(f"{process.url}/locations/door")
    expect(other.locator("#chart canvas")).to_be_visible()
    age = page.locator("#at-gate time")
    expect(age).to_have_text(re.compile("ago|now"))

    process.stop()
    for each in (page, other):
        expect(each.locator("#connection")).to_contain_text(re.compile(r"since \d\d:\d\d:\d\d"), timeout=WAIT_MS)
    other.get_by_role("button", name="Day").click()
    expect(other.locator("#chart")).to_contain_text("did not answer")
    before = age.inner_text()
    expect(age).not_to_have_text(before, timeout=WAIT_MS)  # it is counted in the page

    process.restart()
    make_location(process.url, "later", [1])
    for each in (page, other):
        expect(each.locator("#connection")).to_be_hidden(timeout=WAIT_MS)
    expect(page.locator("#at-later")).to_be_visible(timeout=WAIT_MS)
    expect(other.locator("#chart canvas")).to_be_visible(timeout=WAIT_MS)


@pytest.fixture(scope="module")
def url(shared_server: ServerProcess) -> str:
    """The address of a server with a door."""
    make_door(shared_server.url, "door")
    return shared_server.url


def test_what_happens_is_shown_and_takes_nothing_away(url: str, page: Page) -> None:
    make_location(url, "here", [0])
    page.goto(url)
    page.evaluate("performance.clearResourceTimings()")
    link = page.locator("#to-door")
    link.focus()
    page.evaluate("getSelection().selectAllChildren(document.querySelector('#to-door'))")
    post(url, "/locations", {"name": "arrival", "kind": "state", "interval_s": 60})
    expect(page.locator("#at-arrival")).to_be_visible(timeout=WAIT_MS)
    expect(link).to_be_focused()
    assert page.evaluate("getSelection().toString()") == "door"
    page.locator("#q").fill("her")
    expect(page.locator("#at-door")).to_have_count(0)
    expect(page.locator("#q")).to_be_focused()
    asked = "performance.getEntriesByType('resource').filter(each => each.name.includes('fragments')).length"
    quiet = page.evaluate(asked)
    page.wait_for_timeout(2500)
    assert page.evaluate(asked) == quiet  # nothing happened, so nothing is asked


def test_a_deleted_location_says_so(url: str, page: Page) -> None:
    make_location(url, "doomed", [0, 1])
    page.goto(f"{url}/locations/doomed")
    expect(page.locator("#facts")).to_contain_text("Measurements")
    assert httpx.delete(f"{url}/api/v1/locations/doomed", trust_env=False).status_code == 204
    expect(page.locator("#notice")).to_contain_text("doomed was deleted", timeout=WAIT_MS)
    expect(page.get_by_role("button", name="Update now")).to_be_disabled()


def test_a_renamed_location_leads_to_its_page(url: str, page: Page) -> None:
    make_location(url, "old", [0])
    page.goto(f"{url}/locations/old")
    expect(page.locator("#facts")).to_contain_text("Measurements")
    with page.expect_response(lambda answer: answer.url.endswith("/fragments/locations/old") and answer.status == 404):
        httpx.patch(f"{url}/api/v1/locations/old", json={"name": "new"}, trust_env=False).raise_for_status()
    expect(page.locator("#notice")).to_contain_text("old is called new now", timeout=WAIT_MS)
    expect(page.get_by_role("button", name="Save")).to_be_disabled()
    page.locator("#notice a").click(timeout=WAIT_MS)
    expect(page.get_by_role("heading", level=1)).to_contain_text("new")


def test_the_list_of_anomalies_follows_what_becomes_of_locations(url: str, page: Page) -> None:
    page.goto(f"{url}/anomalies")
    expect(page.locator("#anomalies-table")).to_be_visible()
    with page.expect_request("**/fragments/anomalies*", timeout=WAIT_MS):
        make_location(url, "fleeting", [0])


def test_what_is_acknowledged_in_one_tab_is_so_in_all(url: str, page: Page) -> None:
    other, still_open = page.context.new_page(), page.context.new_page()
    other.goto(f"{url}/locations/door")
    still_open.goto(f"{url}/anomalies")
    page.goto(f"{url}/anomalies?state=all")
    rows = [each.locator("tr[id^=anomaly-]") for each in (page, other, still_open)]
    for row in rows:
        expect(row).to_have_class("open")
    number = rows[0].get_attribute("id").removeprefix("anomaly-")  # type: ignore[union-attr]
    page.get_by_label("Note").fill("the cleaner")
    rows[0].get_by_role("button", name="Acknowledge").click()
    for row in rows[:2]:
        expect(row).to_contain_text("the cleaner", timeout=WAIT_MS)
    expect(rows[2]).to_have_count(0, timeout=WAIT_MS)
    post(url, f"/anomalies/{number}/snooze", {"until": time.time() + 3600})
    for row in rows[:2]:
        expect(row).to_contain_text("snoozed by", timeout=WAIT_MS)


def sign_in(context: BrowserContext, url: str, key: str, path: str) -> Page:
    page = context.new_page()
    page.goto(url + path)
    page.get_by_label("Key").fill(key)
    page.get_by_role("button", name="Sign in").click()
    expect(page).to_have_url(url + path)
    return page


def test_all_tabs_end_when_one_signs_out(server: StartServer, page: Page) -> None:
    process = server()
    key = make_key(("--data", str(process.data)), "operator")["key"]
    one = sign_in(page.context, process.url, key, "/")
    other = page.context.new_page()
    other.goto(f"{process.url}/anomalies")
    expect(other.get_by_role("heading", level=1)).to_have_text("Anomalies")
    one.get_by_role("button", name="Sign out").click()
    expect(other.get_by_role("heading", level=1)).to_have_text("Sign in", timeout=WAIT_MS)
    assert other.url == f"{process.url}/login?next=%2Fanomalies"
