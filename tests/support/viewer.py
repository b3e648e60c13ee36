"""A small grid with a known rhythm, and eyes for the viewer: exact colours, and where a cell is on the screen."""

import io
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page

from tests.support.waiting import WAIT_S
from tidemap_web.viewer import colors

SHAPE = (10, 6, 4)
RESOLUTION_M = 0.5
WALL = [(i, 5, k) for i in range(10) for k in range(4)]  # always occupied
SHUTTER = [(i, 0, k) for i in range(3, 8) for k in range(3)]  # occupied by day, 08:00 to 18:00
FLOOR = [(i, j, 0) for i in range(10) for j in range(1, 5)]  # always free
START = datetime(2026, 3, 2, tzinfo=UTC)  # a Monday; London is on UTC
DAYS = 14
Pixels = NDArray[np.uint8]


def cell(index: tuple[int, int, int]) -> int:
    """The linear index of a grid index."""
    return int(np.ravel_multi_index(index, SHAPE))


def look_around(moment: datetime, extra: list[tuple[int, int, int]] | None = None) -> dict[str, object]:
    """What a robot sees that sees everything, with some floor cells unexpectedly occupied."""
    shut = SHUTTER if 8 <= moment.hour < 18 else []
    occupied = [*WALL, *shut, *(extra or [])]
    free = [each for each in (*SHUTTER, *FLOOR) if each not in occupied]
    return {
        "time": moment.timestamp(),
        "occupied": [cell(each) for each in occupied],
        "free": [cell(each) for each in free],
    }


def make_grid(url: str, name: str, days: int = DAYS) -> datetime:
    """A grid seen every half hour for some days, with a model; the time of the last look."""
    form = {
        "name": name,
        "kind": "grid3d",
        "interval_s": 1800,
        "time_zone": "Europe/London",
        "grid": {"resolution_m": RESOLUTION_M, "shape": list(SHAPE), "origin": [1.0, -2.0, 0.0]},
    }
    post(url, "/locations", form)
    moments = [START + timedelta(minutes=30 * i) for i in range(48 * days)]
    post(url, f"/locations/{name}/observations", {"observations": [look_around(m) for m in moments]})
    job = post(url, f"/locations/{name}/update?wait=60", {"estimator": "fft", "order": 3})
    assert job["state"] == "done", job
    return moments[-1]


def post(url: str, path: str, body: object) -> dict[str, Any]:
    """POST JSON to the API and return the answer."""
    answer = httpx.post(f"{url}/api/v1{path}", json=body, timeout=90, trust_env=False)
    assert answer.is_success, answer.text
    found: dict[str, Any] = answer.json()
    return found


def color_of(url: str, name: str, moment: datetime, index: tuple[int, int, int]) -> colors.Rgb:
    """The colour that the legend gives to a cell's probability."""
    query = {"time": moment.timestamp()}
    state = httpx.get(f"{url}/api/v1/locations/{name}/state", params=query, trust_env=False).json()
    probability = state["probability"][state["cell"].index(cell(index))]
    red, green, blue = colors.of_probability(np.array([probability]))[0].tolist()
    return red, green, blue


@dataclass
class Viewer:
    """A tab that shows a grid."""

    page: Page
    url: str

    @classmethod
    def open(cls, page: Page, url: str, name: str, moment: datetime | None = None, dim: bool = False) -> "Viewer":
        """Open the viewer at a moment (None: live), all coloured unless `dim`, and wait until it has drawn."""
        time_query = "" if moment is None else f"&time={moment.timestamp():.0f}"
        page.goto(f"{url}/view/?location={name}{time_query}&fixedDpr=1")
        viewer = cls(page, url)
        viewer.until(lambda: viewer.session()["updates"] >= 1 and viewer.session()["idle"])
        if not dim:
            page.get_by_label("Grey what is always occupied").uncheck()
        return viewer

    def session(self) -> dict[str, Any]:
        """What the server says of this tab."""
        token = self.page.evaluate("document.body.dataset.token")
        sessions = httpx.get(f"{self.url}/view/sessions", trust_env=False).json()
        nothing: dict[str, Any] = {"updates": 0, "idle": False, "time": None, "location": None}
        return next((each for each in sessions if each["session"] == token[:6]), nothing)

    def go(self, moment: datetime) -> None:
        """Move the timeline, as a hand on the slider does, and wait until that has been drawn."""
        self.page.eval_on_selector(
            "#time", "(s, t) => { s.value = t; s.dispatchEvent(new Event('input')); }", str(moment.timestamp())
        )
        self.until(lambda: self.session()["time"] == moment.timestamp() and self.session()["idle"])

    def until(self, true: Callable[[], object]) -> None:
        """Wait for something to become true, for at most WAIT_S."""
        deadline = time.monotonic() + WAIT_S
        while not true():
            assert time.monotonic() < deadline, f"not true in {WAIT_S} s; {self.session()}"
            self.page.wait_for_timeout(30)

    def pixels(self) -> Pixels:
        """The scene as it is on the screen, (height, width, 3)."""
        image = Image.open(io.BytesIO(self.page.locator("#scene").screenshot()))
        return np.asarray(image.convert("RGB"))

    def shows(self, color: colors.Rgb, half: str) -> int:
        """How many pixels of a half of the scene (left: predicted, right: observed) have exactly a colour."""
        pixels = self.pixels()
        middle = pixels.shape[1] // 2
        part = pixels[:, :middle] if half == "left" else pixels[:, middle:]
        return int((part == np.array(color, dtype=np.uint8)).all(axis=2).sum())

    def shows_about(self, color: colors.Rgb, half: str, tolerance: int = 40) -> int:
        """How many pixels of a half are near a colour: lines are toned by the browser, cells are not."""
        pixels = self.pixels().astype(int)
        middle = pixels.shape[1] // 2
        part = pixels[:, :middle] if half == "left" else pixels[:, middle:]
        return int((np.abs(part - np.array(color)).max(axis=2) <= tolerance).sum())

    def pixel_of(self, index: tuple[int, int, int]) -> tuple[int, int]:
        """Where the centre of a predicted cell is in the scene, x and y in pixels."""
        matrices = self.page.evaluate(
            "() => { const c = document.getElementById('scene').contentWindow.__viserMutable.camera;"
            " return [c.projectionMatrix.elements, c.matrixWorldInverse.elements]; }"
        )
        projection, view = (np.array(each).reshape(4, 4).T for each in matrices)
        x, y, z = np.array([1.0, -2.0, 0.0]) + (np.array(index) + 0.5) * RESOLUTION_M
        clip = projection @ view @ np.array([-y, z, -x, 1.0])  # three.js has y up
        box = self.page.locator("#scene").bounding_box()
        assert box is not None
        across, down = clip[0] / clip[3], clip[1] / clip[3]
        return math.floor((across + 1) / 2 * box["width"]), math.floor((1 - down) / 2 * box["height"])
