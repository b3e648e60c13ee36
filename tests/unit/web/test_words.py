"""Words for numbers and times."""

import pytest

from tidemap_web.pages import guard, words
from tidemap_web.pages.assets import asset


@pytest.mark.parametrize(
    ("away", "text"),
    [
        (3, "just now"),
        (60, "60 s ago"),
        (600, "10 min ago"),
        (7200, "2 h ago"),
        (3 * 86400, "3 days ago"),
        (90 * 86400, "3 months ago"),
        (-600, "in 10 min"),
    ],
)
def test_relative_times(away: float, text: str) -> None:
    assert words.relative(1e9 - away, 1e9) == text


def test_local_times_follow_daylight_saving() -> None:
    before, after = 1774742400, 1774915200  # 2026-03-29 is the day of the change
    assert words.local_time(before, "Europe/London") == "Sun 29 Mar 2026, 00:00:00 GMT"
    assert words.local_time(after, "Europe/London") == "Tue 31 Mar 2026, 01:00:00 BST"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(86400, "24 h"), (604800, "7 d"), (43200, "12 h"), (900, "15 min"), (3600, "1 h"), (1, "1 s")],
)
def test_durations(seconds: float, text: str) -> None:
    assert words.duration(seconds) == text


@pytest.mark.parametrize(
    "address",
    ["//evil.example", "https://evil.example", "/\\evil.example", "evil", "", "/a\nSet-Cookie: b"],
)
def test_nobody_is_sent_elsewhere_after_signing_in(address: str) -> None:
    assert guard.local(address) == "/"


def test_scripts_that_import_one_another_carry_one_version() -> None:
    assert asset("location.js") == asset("core/words.js").replace("core/words.js", "location.js")
    with pytest.raises(KeyError):
        asset("no-such.js")
