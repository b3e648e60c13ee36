"""Sessions: the newest request wins, one update at a time, and the page shows what is the matter."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser

from tests.support.records import location_record
from tests.support.waiting import WAIT_S
from tests.unit.web.states import DOOR, NOW, FakeSource, location
from tidemap.space.pose import FramedPosition
from tidemap_web.viewer import colors
from tidemap_web.viewer.messages import Aim, Hover, Select, ViewRequest, parse
from tidemap_web.viewer.picking import Ray
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.session import Session

SEEN_THERE = {name: {name: frozenset({"observation"})} for name in ("lab", "yard")}


class Page:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []
        self._more = threading.Condition()

    def hear(self, message: dict[str, Any]) -> None:
        with self._more:
            self.told.append(message)
            self._more.notify_all()

    def last(self, kind: str, true: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The newest message of a kind that fulfils a condition; waits for it."""

        def found() -> dict[str, Any] | None:
            return next((m for m in reversed(self.told) if m["kind"] == kind and true(m)), None)

        with self._more:
            assert self._more.wait_for(found, timeout=WAIT_S), self.told
            return found() or {}


class FakeScene(Scene):
    """Counts what is drawn; `gate` holds updates back until it is set, as a slow browser does."""

    def __init__(self) -> None:
        self.client = cast(viser.ClientHandle, SimpleNamespace(atomic=self._atomic, flush=lambda: None))
        self.layout: Any = None
        self.drawn: list[str] = []
        self.around: Any = None
        self.cropped: Any = None
        self.gate = threading.Event()
        self.gate.set()
        self.fails: Exception | None = None

    @contextmanager
    def _atomic(self) -> Iterator[None]:
        yield

    def clear(self) -> None:
        self.drawn.append("clear")
        self.layout = None

    def build(self, layout: Any) -> None:
        self.drawn.append("build")
        self.layout = layout

    def aim(self, from_above: bool) -> None:
        self.drawn.append("above" if from_above else "slanted")

    def put_camera(self, pose: Any) -> None:
        self.drawn.append(f"at {pose}")

    def show(self, board: Any, picture: Any) -> None:
        self.drawn.append("show")

    def show_all(self, board: Any) -> None:
        self.drawn.append("show all")

    def outline(self, boxes: Any) -> None:
        self.drawn.append("outline")

    def surround(self, around: Any) -> None:
        self.around = around

    def crop(self, bounds: Any) -> None:
        self.cropped = bounds

    def ray(self, at: tuple[float, float]) -> Ray:
        down = np.diag([1.0, -1.0, -1.0])
        return Ray(np.array([1 + at[0], 2 + at[1] * 1.5, 99.0]), np.array([0.0, 0.0, -1.0]), down)

    def select(self, index: Any) -> None:
        self.drawn.append("select" if index is not None else "-")

    def send(self, wait_s: float) -> None:
        assert self.gate.wait(WAIT_S)
        if self.fails is not None:
            error, self.fails = self.fails, None
            raise error


@pytest.fixture
def page() -> Page:
    return Page()


@contextmanager
def running(source: FakeSource, page: Page) -> Iterator[Session]:
    session = Session("0123456789abcdef", source, page.hear)
    session.start()
    try:
        yield session
    finally:
        session.close()


def test_it_opens_with_the_first_grid_at_its_newest_time(page: Page) -> None:
    with running(FakeSource("lab", "yard"), page) as session:
        session.attach(FakeScene())
        session.ask(ViewRequest())
        assert page.last("grids")["items"] == [
            {"name": "lab", "kind": "grid3d"},
            {"name": "yard", "kind": "grid3d"},
        ]
        assert page.last("location")["time_zone"] == "Europe/London"
        frame = page.last("frame")
        assert (frame["location"], frame["time"], frame["revision"]) == ("lab", NOW, 1)
        assert (frame["predicted"], frame["observed"], frame["unexpected"]) == (2, 2, 1)


def test_only_the_newest_of_many_requests_is_drawn(page: Page) -> None:
    source, scene = FakeSource("lab"), FakeScene()
    with running(source, page) as session:
        session.attach(scene)
        page.last("frame")
        scene.gate.clear()
        for i in range(100):
            session.ask(ViewRequest(time=NOW - i))
        assert not session.stats()["idle"]
        scene.gate.set()
        page.last("frame", lambda frame: frame["time"] == NOW - 99)
        assert len(source.asked) < 5


def test_a_scene_is_built_once_and_again_for_another_grid(page: Page) -> None:
    scene = FakeScene()
    with running(FakeSource("lab", "yard"), page) as session:
        session.attach(scene)
        session.ask(ViewRequest(location="lab", time=NOW - 1))
        page.last("frame", lambda frame: frame["time"] == NOW - 1)
        session.ask(ViewRequest(location="lab", time=NOW - 2))
        page.last("frame", lambda frame: frame["time"] == NOW - 2)
        assert scene.drawn.count("build") == 1
        session.ask(ViewRequest(location="yard"))
        page.last("frame", lambda frame: frame["location"] == "yard")
        assert scene.drawn.count("build") == 2
        session.ask(Aim(kind="aim", view="above"))
        session.ask(Select(kind="select", cell=5))
        selected = page.last("frame", lambda frame: frame["selected"] is not None)["selected"]
        assert scene.drawn.count("above") == 1
        assert (selected["index"], selected["position_m"]) == ([0, 1, 1], [1.25, 2.75, 3.75])


def test_live_moves_with_new_observations_and_others_do_not_disturb(page: Page) -> None:
    source = FakeSource("lab", "yard")
    with running(source, page) as session:
        session.ask(ViewRequest(location="lab", live=True))
        page.last("frame")
        source.locations["lab"] = location("lab", NOW + 60)
        session.notify(SEEN_THERE["yard"])
        session.notify(SEEN_THERE["lab"])
        page.last("frame", lambda frame: frame["time"] == NOW + 60)
        assert page.last("location")["span"]["last"] == NOW + 60


def test_a_new_location_appears_in_the_list(page: Page) -> None:
    source = FakeSource("lab")
    with running(source, page) as session:
        session.ask(ViewRequest())
        page.last("frame")
        source.locations["yard"] = location("yard")
        session.notify({"yard": frozenset({"location"})})
        page.last("grids", lambda grids: len(grids["items"]) == 2)


def test_posts_to_doors_have_no_grids_listed_anew(page: Page) -> None:
    source = FakeSource("lab")
    with running(source, page) as session:
        session.ask(ViewRequest(location="lab"))
        page.last("frame")
        page.told.clear()
        session.notify({DOOR: frozenset({"observation"})})
        session.notify(SEEN_THERE["lab"])
        page.last("frame")
        assert "grids" not in {message["kind"] for message in page.told}


def test_it_says_why_there_is_nothing_to_see(page: Page) -> None:
    with running(FakeSource(), page) as session:
        session.ask(ViewRequest())
        assert page.last("notice")["reason"] == "no-grids"


def test_before_there_is_a_model_it_shows_what_was_last_seen(page: Page) -> None:
    with running(FakeSource("lab", without_model=("lab",)), page) as session:
        session.ask(ViewRequest())
        page.last("frame")
        session.ask(Select(kind="select", cell=23))
        frame = page.last("frame", lambda frame: frame["selected"] is not None)
        assert (frame["revision"], frame["predicted"], frame["observed"]) == (0, 0, 2)
        assert (frame["unexpected"], frame["missing"], frame["structure"]) == (0, 0, 0)
        assert (frame["selected"]["probability"], frame["selected"]["observed"]) == (None, 1)
        assert page.last("location")["first_update"] == 100


def test_it_recovers_from_what_is_missing(page: Page) -> None:
    source = FakeSource("lab")
    source.locations["lab"] = location("lab", None)
    with running(source, page) as session:
        session.ask(ViewRequest(location="nowhere"))
        assert page.last("notice")["reason"] == "not-found"
        session.ask(ViewRequest(location="lab"))
        page.last("notice", lambda notice: notice["reason"] == "no-observations")
        source.locations["lab"] = location("lab")
        session.notify(SEEN_THERE["lab"])
        page.last("frame")


def test_a_browser_that_has_gone_is_painted_anew_when_it_is_back(page: Page) -> None:
    scene = FakeScene()
    with running(FakeSource("lab"), page) as session:
        scene.fails = ConnectionError()
        session.attach(scene)
        session.ask(ViewRequest(time=NOW - 1))
        page.last("frame", lambda frame: frame["time"] == NOW - 1)
        again = FakeScene()
        session.attach(again)
        session.ask(ViewRequest(time=NOW - 2))
        page.last("frame", lambda frame: frame["time"] == NOW - 2)
        assert "build" in again.drawn


def test_a_browser_that_sleeps_does_not_hold_up_the_page(page: Page) -> None:
    scene = FakeScene()
    with running(FakeSource("lab"), page) as session:
        scene.fails = TimeoutError()
        session.attach(scene)
        page.last("frame")
        session.ask(ViewRequest(time=NOW - 2))
        page.last("frame", lambda frame: frame["time"] == NOW - 2)
        assert scene.drawn.count("build") == 1


def test_what_was_last_seen_is_loaded_while_the_prediction_is_shown(page: Page) -> None:
    source = FakeSource("lab")
    source.at_hand = False
    with running(source, page) as session:
        session.attach(FakeScene())
        session.ask(ViewRequest(time=NOW))
        page.last("frame", lambda frame: frame["predicted"] == 2 and frame["observed"] == 0)
        assert page.last("progress", lambda progress: progress["done"] == 0.5)["what"] == "what was last seen"
        page.last("progress", lambda progress: progress["done"] is None)
        page.last("frame", lambda frame: frame["observed"] == 2)


def test_a_grid_that_is_deleted_while_it_is_shown_is_said_to_be(page: Page) -> None:
    source = FakeSource("lab", "yard")
    with running(source, page) as session:
        session.ask(ViewRequest(location="lab"))
        page.last("frame")
        del source.locations["lab"]
        session.notify({"lab": frozenset({"location"})})
        assert page.last("notice")["reason"] == "deleted"
        page.last("grids", lambda grids: [item["name"] for item in grids["items"]] == ["yard"])
        page.told.clear()
        session.notify({"yard": frozenset({"location"})})
        assert page.last("notice")["reason"] == "deleted"


def test_a_location_that_is_no_grid_is_said_to_be_none(page: Page) -> None:
    with running(FakeSource("lab"), page) as session:
        session.ask(ViewRequest(location=DOOR))
        assert page.last("notice")["reason"] == "no-grid"


def test_what_is_under_the_pointer_is_said_without_painting(page: Page) -> None:
    source = FakeSource("lab")
    with running(source, page) as session:
        session.attach(FakeScene())
        session.ask(ViewRequest(time=NOW))
        page.last("frame", lambda frame: frame["drawn"])
        asked = len(source.asked)
        session.ask(Hover(kind="hover", at=[0.25, 0.5]))
        hovered = page.last("hovered")
        assert (hovered["at"], hovered["cell"]["index"], hovered["cell"]["observed"]) == ((0.25, 0.5), [0, 1, 1], 0)
        session.ask(Hover(kind="hover", at=[0.9, 0.1]))
        assert page.last("hovered", lambda found: found["at"] == (0.9, 0.1))["cell"] is None
        assert len(source.asked) == asked


def test_doors_stand_in_their_building_and_sensors_where_they_were(page: Page) -> None:
    source, scene = FakeSource("lab"), FakeScene()
    pose = FramedPosition("map", (1.25, 2.25, 3.5))
    source.doors, source.scanned = [location_record(name=DOOR, pose=pose, last_time=NOW)], True
    with running(source, page) as session:
        session.attach(scene)
        session.ask(ViewRequest(time=NOW))
        (marker,) = page.last("markers")["items"]
        assert (marker["name"], marker["verdict"], marker["observed"]) == (DOOR, "uncertain", 1)
        assert marker["colors"] == [colors.css(colors.UNCERTAIN), colors.css(colors.OCCUPIED)]
        page.last("frame", lambda frame: frame["drawn"])
        (track,) = scene.around.tracks
        assert (track.source, track.points.tolist()) == ("spot", [[1, 2, 0], [1, 2, 1]])
        session.ask(Hover(kind="hover", at=[0.25, 1 / 6]))
        assert page.last("hovered")["marker"]["name"] == DOOR
        session.pick(scene.ray((0.25, 1 / 6)))
        assert page.last("picked") == {"kind": "picked", "cell": None, "marker": DOOR}
        page.told.clear()
        session.notify(SEEN_THERE["lab"] | {DOOR: frozenset({"observation"})})
        page.last("frame")
        session.ask(ViewRequest(time=NOW - 30))
        page.last("frame", lambda frame: frame["time"] == NOW - 30)
        assert [track.points.tolist() for track in scene.around.tracks] == [[[1, 2, 0]]]


def test_the_amplitude_of_a_day_is_worked_out_once_and_a_crop_is_framed(page: Page) -> None:
    source, scene = FakeSource("lab"), FakeScene()
    with running(source, page) as session:
        session.attach(scene)
        for hour in (0, 1, 25):
            session.ask(ViewRequest(time=NOW - 3600 * hour, predicted="day", crop=[0, 0, 1, 1]))
            page.last("frame", lambda frame, hour=hour: frame["time"] == NOW - 3600 * hour)  # type: ignore[misc]
        assert source.days == [NOW - NOW % 86400, NOW - NOW % 86400 - 86400]
        assert scene.cropped == (1.0, 2.5, 3.0, 1.5, 3.0, 5.0)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"kind": "view", "time": "today"}', '{"kind": "view", "floor": 2}', '{"kind": "x"}']
)
def test_a_wrong_message_is_refused(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        parse(text)


def test_a_request_may_leave_everything_out() -> None:
    assert parse('{"kind": "view"}') == ViewRequest()
