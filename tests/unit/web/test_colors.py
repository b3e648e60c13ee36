"""Colours that everybody can tell apart: every entry of a legend from every other, whatever eyes one has."""

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tidemap_web
from tests.support.colour_vision import delta_e, least_apart
from tidemap_web.viewer import colors

APART = 15.0
WALLS = np.linspace(np.array(colors.STRUCTURE[0], float), np.array(colors.STRUCTURE[1], float), 9)
TICKS = colors.of_probability(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
MARKS: dict[str, Any] = {
    "occupied, expected free": [colors.UNEXPECTED],
    "free, expected occupied": [colors.MISSING],
    "not judged": [colors.STALE],
    "always occupied": WALLS,
    "where a sensor was": [colors.TRACK],
    "the chosen cell": [colors.SELECTED],
    "the ground": [colors.BACKGROUND],
}
LEGEND: dict[str, Any] = {"probability": colors.SCALE, **MARKS}


@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_the_measure_is_that_of_its_publication(one: tuple[float, ...], other: tuple[float, ...], apart: float) -> None:
    assert delta_e(one, other) == pytest.approx(apart, abs=1e-4)


@pytest.mark.parametrize(("one", "other"), list(combinations(LEGEND, 2)))
def test_two_entries_of_the_scenes_legend_are_apart(one: str, other: str) -> None:
    apart, vision = least_apart(LEGEND[one], LEGEND[other])
    assert apart >= APART, vision


@pytest.mark.parametrize(("one", "other"), list(combinations(range(len(TICKS)), 2)))
def test_two_ticks_of_the_scale_are_apart(one: int, other: int) -> None:
    apart, vision = least_apart(TICKS[one], TICKS[other])
    assert apart >= APART, vision


@given(st.lists(st.floats(0, 1), min_size=2, max_size=50))
def test_the_scale_grows_brighter(probabilities: list[float]) -> None:
    ordered = np.sort(np.array(probabilities))
    luminance = colors.of_probability(ordered) @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(luminance) >= -0.5).all()


def test_what_was_seen_otherwise_grows_from_dark_to_its_mark() -> None:
    found = colors.PALETTE[colors.code_of_difference(np.array([-1.0, 0.0, 1.0]))].tolist()
    assert np.array(found) == pytest.approx(
        np.array([colors.MISSING, colors.STRUCTURE[0], colors.UNEXPECTED], float), abs=1
    )


STRIP = ("predicted", "occupied", "free", "uncertain", "anomaly")


@pytest.mark.parametrize("scheme", [0, 1])
@pytest.mark.parametrize(("one", "other"), list(combinations(STRIP, 2)))
def test_two_entries_of_a_charts_legend_are_apart(one: str, other: str, scheme: int) -> None:
    sheet = (Path(tidemap_web.__file__).parent / "pages" / "static" / "tidemap.css").read_text("utf-8")
    found = [colors.rgb(re.findall(rf"--{name}: #([0-9a-f]{{6}})", sheet)[scheme]) for name in (one, other)]
    apart, vision = least_apart([found[0]], [found[1]])
    assert apart >= APART, vision
