"""The pure modules of the pages, run by the browser; what Python says too, both say alike."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, Route

from tidemap_web.pages import words
from tidemap_web.pages.assets import STATIC

ORIGIN = "http://modules.test"
ZONES = ["Europe/London", "America/St_Johns", "Asia/Kolkata", "UTC"]
AWAY = [0, 9, 10, 89.5, 90, 150, 5399, 5400, 9000, 129599, 129600, 216000, 60 * 86400 - 1, 60 * 86400, 4e7]
LENGTHS = [0.5, 1, 99, 100, 300, 3599, 3600, 43200, 29030.4, 86400, 47 * 3600, 604800]


@pytest.fixture
def module(page: Page) -> Page:
    """A page that imports modules from the folder of static files, without a server."""

    def answer(route: Route) -> None:
        path = STATIC / route.request.url.removeprefix(f"{ORIGIN}/")
        if path.suffix == ".js":
            route.fulfill(body=path.read_text(), content_type="text/javascript")
        else:
            route.fulfill(body="<!doctype html><main></main>", content_type="text/html")

    page.route("**/*", answer)
    page.goto(f"{ORIGIN}/")
    return page


def run(page: Page, module: str, script: str, *given: Any) -> Any:
    """What a script says, with all of a module as `m`."""
    assert Path(STATIC, module).exists()
    return page.evaluate(
        f"async (given) => {{ const m = await import('/{module}'); return ({script})(...given); }}", given
    )


def test_a_heartbeat_says_when_nobody_answers_and_gives_up(module: Page) -> None:
    module.clock.install()
    begin = """() => {
      window.log = [];
      const silent = (since) => log.push(since === null ? "heard" : "silent");
      window.heart = new m.Heartbeat({ ask: () => log.push("ask"), silent, give: () => log.push("give") });
      heart.start();
    }"""
    run(module, "core/heartbeat.js", begin)
    for milliseconds, heard in ((2600, True), (9000, True), (2600, False), (40_000, False)):
        module.clock.run_for(milliseconds)
        if heard:
            module.evaluate("heart.heard()")
    assert module.evaluate("log") == ["ask", "ask", "silent", "heard", "ask", "silent", "heard", "give"]


def test_an_address_has_a_crop_of_cells_in_their_order(module: Page) -> None:
    asked = ["0-4,5-5", "4-0,5-5", "0-4", "0-99999,0-1", ""]
    read = "(asked) => asked.map((crop) => m.readAddress(`?crop=${crop}`).crop)"
    assert run(module, "core/address.js", read, asked) == [[0, 4, 5, 5], None, None, None, None]


def test_words_are_the_same_in_both_languages(module: Page) -> None:
    now = 1.7e9
    for sign in (-1, 1):
        times = [now + sign * away for away in AWAY]
        said = run(
            module, "core/words.js", "(times, now) => times.map((time) => m.relativeText(time, now))", times, now
        )
        assert said == [words.relative(time, now) for time in times]
    said = run(module, "core/words.js", "(lengths) => lengths.map(m.durationText)", LENGTHS)
    assert said == [words.duration(length) for length in LENGTHS]
    moments = [1774742400, 1774915200, 0, 1.7e9]
    for zone in ZONES:
        said = run(
            module, "core/words.js", "(times, zone) => times.map((time) => m.timeText(time, zone))", moments, zone
        )
        assert said == [words.local_time(time, zone).rpartition(" ")[0] for time in moments]


def test_ticks_stand_at_whole_hours_and_days_across_a_change_of_the_clock(module: Page) -> None:
    start = datetime(2026, 3, 28, 12, tzinfo=UTC).timestamp()  # London's clock changes on the 29th
    script = "(low, high, step, zone) => m.ticksOf(low, high, step, zone)"
    days = run(module, "core/ticks.js", script, start, start + 3 * 86400, 86400, "Europe/London")
    assert days == [datetime(2026, 3, 29, tzinfo=UTC).timestamp() + each for each in (0, 82800, 82800 + 86400)]
    texts = run(module, "core/ticks.js", "(ticks, zone) => m.tickTexts(ticks, zone)", days, "Europe/London")
    assert texts == ["Sun 29 Mar", "Mon 30 Mar", "Tue 31 Mar"]
    steps = run(
        module, "core/ticks.js", "(lengths) => lengths.map((length) => m.stepOf(length, 8))", [600, 86400, 30 * 86400]
    )
    assert steps == [300, 10800, 7 * 86400]
    many = run(module, "core/ticks.js", script, 0, 1e12, 60, "UTC")
    assert len(many) <= 200


def test_a_text_that_would_be_cut_off_at_the_end_of_an_axis_is_left_out(module: Page) -> None:
    script = "(texts, ticks, room) => m.fitting(texts, ticks, 100, 1, room)"
    texts, ticks = ["Sun 29 Mar", "Mon 30 Mar", "12:00\nTue 31 Mar"], [0, 64, 90]
    assert run(module, "core/ticks.js", script, texts, ticks, 6) == ["Sun 29 Mar", "Mon 30 Mar", ""]
    assert run(module, "core/ticks.js", script, texts, ticks, 25) == texts


def test_a_week_is_averaged_by_the_hours_of_the_local_clock(module: Page) -> None:
    monday = datetime(2026, 3, 23, 8, 30, tzinfo=UTC).timestamp()
    after = datetime(2026, 3, 30, 7, 30, tzinfo=UTC).timestamp()  # 8:30 again, in summer time
    script = "(times, values, zone) => m.weekOf(times, values, zone)"
    week = run(module, "core/week.js", script, [monday, after, after + 3600], [1, 0, None], "Europe/London")
    assert (week["mean"][8], week["count"][8]) == (0.5, 2)
    assert sum(week["count"]) == 2
    assert week["mean"][9] is None
    begun = run(module, "core/week.js", "(time, zone) => m.mondayBefore(time, zone)", after, "Europe/London")
    assert begun == datetime(2026, 3, 29, 23, tzinfo=UTC).timestamp()


def test_what_is_the_same_stays_and_what_is_not_is_changed(module: Page) -> None:
    script = """(before, after) => {
      const host = document.querySelector("main");
      host.innerHTML = before;
      const kept = Object.fromEntries([...host.querySelectorAll("[id]")].map((each) => [each.id, each]));
      host.querySelector("input")?.focus();
      const box = host.querySelector("input[type=checkbox]");
      if (box) box.checked = true;
      const made = document.createElement("template");
      made.innerHTML = after;
      m.morph(host, made.content);
      const ids = [...host.querySelectorAll("[id]")].map((each) => each.id);
      return {
        html: host.innerHTML, same: ids.filter((id) => kept[id] === document.getElementById(id)),
        focus: document.activeElement.id, checked: box?.checked,
      };
    }"""
    before = '<p id="a">1</p><p id="b" class="x"><input id="i" type="checkbox"></p><p id="c">3</p>text'
    after = '<p id="c">3</p><p id="n">new</p><p id="b"><input id="i" type="checkbox"> more</p>other'
    found = run(module, "core/morph.js", script, before, after)
    assert found["html"] == after
    assert found["same"] == ["c", "b", "i"]
    assert (found["focus"], found["checked"]) == ("i", True)
    assert run(module, "core/morph.js", script, after, before)["html"] == before
    assert run(module, "core/morph.js", script, "<b>x</b>", "")["html"] == ""


def test_moments_are_read_in_the_zone_that_is_shown_also_when_clocks_change(module: Page) -> None:
    texts = ["29 mar 2:30", "29 mar 0:30", "yesterday 8:00", "now", "+90 min", "sat", "25:00", "31 feb", "soon"]
    at = {"shown": 1774780000, "now": 1774783600, "zone": "Europe/London"}  # Sunday 29 March 2026, 11:26 BST
    said = run(module, "core/time.js", "(texts, at) => texts.map((text) => m.readMoment(text, at))", texts, at)
    assert said == [1774747800, 1774744200, 1774684800, 1774783600, 1774785400, 1774656000, None, None, None]


def test_an_address_says_what_was_chosen_and_nothing_else(module: Page) -> None:
    view = "{ ...begin, ...m.readAddress(query) }"
    begin = "const begin = (await import('/core/state.js')).initialView();"
    script = f"async (query) => {{ {begin} return m.writeAddress({view}, query); }}"
    for query in (
        "?location=lab",
        "?location=lab&time=1772872200.5&confidence=0.8&order=0&cell=121&floor=0.3&layout=overlay&zone=UTC",
        "?location=lab&walls=coloured&slice=1-2&camera=4%2C-9%2C7.25%2C3%2C0%2C1&fixedDpr=1",
    ):
        assert run(module, "core/address.js", script, query) == query
    for time in ("99999999999999999999", "-60000000001", "1e9"):  # nothing that a clock can show
        assert run(module, "core/address.js", script, f"?location=lab&time={time}") == "?location=lab"
    cells = run(module, "core/address.js", "(texts) => texts.map(m.cellOf)", ["7", "abc", "", "-1", None])
    assert cells == [7, None, None, None, None]
    unusable = "?location=lab&time=2026-03-07T09:30:00&confidence=2&order=x&cell=-1&layout=heap&camera=1,2"
    assert run(module, "core/address.js", script, unusable) == "?location=lab"


@pytest.mark.parametrize(("status", "said"), [(200, ["lost"]), (404, ["lost", "back"])])
def test_a_stream_of_what_is_gone_is_not_taken_for_a_lost_connection(
    module: Page, status: int, said: list[str]
) -> None:
    script = """async (status) => {
      let opened = 0;
      window.WebSocket = class {
        constructor() { opened += 1; setTimeout(() => this.onclose({ code: 1006 })); }
        close() {}
      };
      window.fetch = async (address) => ({ status: address === "/api/v1/locations/lab" ? status : 200 });
      const said = [];
      await new Promise((resolve) => new m.Live("?location=lab", "/locations/lab").onConnection((since) => {
        said.push(since === null ? "back" : "lost");
        setTimeout(resolve, 700);
      }));
      return { said, again: opened > 1 };
    }"""
    assert run(module, "core/live.js", script, status) == {"said": said, "again": status == 200}


def test_the_address_of_a_location_carries_cell_and_moment(module: Page) -> None:
    read = "(search, isGrid) => m.readLocation(search, { isGrid })"
    moment = datetime(2026, 3, 5, 10, tzinfo=UTC).timestamp()
    for search, is_grid, expected in (
        ("?cell=7&time=2026-03-05T10:00:00Z", True, {"cell": 7, "time": moment}),
        (f"?cell=7&time={moment}", False, {"cell": 0, "time": moment}),
        ("?cell=x&time=10:00", True, {"cell": None, "time": None}),
    ):
        assert run(module, "core/location.js", read, search, is_grid) == expected
    write = "(cell, time, search) => m.writeLocation({ cell, time, isGrid: true }, search)"
    assert (
        run(module, "core/location.js", write, 7, moment + 0.25, "?x=1&time=3") == f"?x=1&time={moment + 0.25}&cell=7"
    )
    assert run(module, "core/location.js", write, None, None, "?cell=3&time=3") == "/"
