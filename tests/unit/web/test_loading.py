"""Loading: one thing at a time, the newest; what nobody waits for any more is given up."""

import threading
from typing import Any

from tests.support.waiting import WAIT_S
from tests.unit.web.states import NOW, FakeSource
from tidemap.services.context import Seen
from tidemap.services.films import Watch
from tidemap.services.map_view import MapQuery
from tidemap_web.viewer.loading import Loader


class SlowSource(FakeSource):
    """Its first chunk takes until `go_on`."""

    def __init__(self) -> None:
        super().__init__("lab", "yard")
        self.begun = threading.Semaphore(0)
        self.go_on = threading.Event()
        self.loaded: list[str] = []

    def load(self, query: MapQuery, watch: Watch) -> Seen | None:
        self.begun.release()
        assert self.go_on.wait(WAIT_S)
        seen = super().load(query, watch)
        self.loaded.append(query.location)
        return seen


def loading() -> tuple[SlowSource, Loader, "Heard"]:
    source, heard = SlowSource(), Heard()
    return source, Loader(source, heard.shares.append, heard.done), heard


class Heard:
    def __init__(self) -> None:
        self.shares: list[float] = []
        self.answers: list[Any] = []
        self.more = threading.Semaphore(0)

    def done(self, query: MapQuery, seen: Seen | None) -> None:
        self.answers.append((query.location, query.time, seen is not None))
        self.more.release()


def test_another_location_gives_up_what_is_loaded() -> None:
    source, loader, heard = loading()
    loader.want(MapQuery("lab", NOW))
    assert source.begun.acquire(timeout=WAIT_S)
    loader.want(MapQuery("yard", NOW))
    source.go_on.set()
    assert heard.more.acquire(timeout=WAIT_S)
    assert heard.answers == [("yard", NOW, True)]
    assert source.loaded == ["yard"]


def test_another_moment_of_the_same_window_goes_on() -> None:
    source, loader, heard = loading()
    loader.want(MapQuery("lab", NOW))
    assert source.begun.acquire(timeout=WAIT_S)
    loader.want(MapQuery("lab", NOW + 1))
    source.go_on.set()
    assert heard.more.acquire(timeout=WAIT_S)
    assert heard.answers == [("lab", NOW, True)]
    assert heard.shares[0] == 0.0
    assert heard.shares == sorted(set(heard.shares))


def test_nothing_is_loaded_for_a_tab_that_has_gone() -> None:
    source, loader, heard = loading()
    loader.want(MapQuery("lab", NOW))
    assert source.begun.acquire(timeout=WAIT_S)
    loader.want(None)
    source.go_on.set()
    loader.want(None)
    assert not heard.more.acquire(timeout=0.2)
    assert source.loaded == []
