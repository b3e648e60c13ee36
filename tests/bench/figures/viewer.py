"""viewer: one time step of 10^6 known cells, computed and sent to a browser, against sending the bytes of both grids.

CPU of the server. `same_bytes` is what sending just the bytes of the step takes: of a million cells it repaints those
whose colour has changed. `post_ms` is a live post of four cells, from what judges it to what draws it; `back_ms` a step
in the past, and `film_ms` the first one there, which loads what was last seen around it. `ratio_10_4` and `ratio_10_5`
are those of smaller grids.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import prod
from typing import Any, cast

import numpy as np
import viser

from tests.bench import million
from tests.bench.figures.observed import NOW, hall
from tests.bench.timing import Figure
from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap_web.viewer.board import Board
from tidemap_web.viewer.messages import ViewRequest
from tidemap_web.viewer.scene import Scene
from tidemap_web.viewer.server import ViewerServer
from tidemap_web.viewer.session import Session

TOKEN = "0123456789abcdef"
STEPS, WAIT_S, DAY_S = 8, 120.0, 86400.0
SHAPES = {"10_4": (25, 20, 20), "10_5": (50, 50, 40)}


class Tab:
    """A tab that is shown in no browser, but to one that answers."""

    def __init__(self, viewer: ViewerServer) -> None:
        self._heard = threading.Condition()
        self._frames: list[dict[str, Any]] = []
        self.session: Session = viewer.open(TOKEN, self._hear)

    def _hear(self, message: dict[str, Any]) -> None:
        with self._heard:
            if message["kind"] == "frame":
                self._frames.append(message)
            self._heard.notify_all()

    def until(self, true: Callable[[dict[str, Any]], object]) -> None:
        """Wait for a frame."""
        with self._heard:
            assert self._heard.wait_for(lambda: self._frames and true(self._frames[-1]), WAIT_S), self._frames[-1:]

    def go(self, at: float) -> None:
        """Show a moment, and wait until it is there."""
        self.session.ask(ViewRequest(location=million.NAME, time=at, dim=False))
        self.until(lambda frame: frame["time"] == at)

    @property
    def scene(self) -> Scene:
        return cast(Scene, self.session._painter._scene)

    @property
    def board(self) -> Board:
        return cast(Board, self.session._painter._board)


def measure() -> Figure:
    details: dict[str, float | int | str] = {}
    for name, shape in SHAPES.items():
        with watched(shape) as (_, tab):
            step_s, _, whole_s = stepped(tab)
            details[f"ratio_{name}"] = round(step_s / whole_s, 3)
    with watched(million.SHAPE) as (ctx, tab):
        step_s, same_s, whole_s = stepped(tab)
        details |= {"same_bytes": round(same_s * 1e3, 2), "cells": prod(million.SHAPE)}
        details["post_ms"] = round(1e3 * posted(ctx, tab), 1)
        film_s, *back_s = (cpu_s(partial(seen_at, tab, NOW - 2 * DAY_S - number * 600.0)) for number in range(5))
        details |= {"film_ms": round(1e3 * film_s, 1), "back_ms": round(1e3 * min(back_s), 1)}
    return Figure(step_s * 1e3, whole_s * 1e3, 1.5, "ms CPU", details)


@contextmanager
def watched(shape: tuple[int, ...]) -> Iterator[tuple[Context, Tab]]:
    """A hall, a tab that shows it with all that was last seen, and what answers as its browser."""
    with hall(shape) as ctx:
        viewer = ViewerServer(ctx)
        viewer.start()
        tab = Tab(viewer)
        ((header, secret),) = viewer.headers.items()
        module = [sys.executable, "-m", "tests.bench.watching", str(viewer.port), TOKEN, header, secret]
        browser = subprocess.Popen(module)
        try:
            tab.go(NOW)
            tab.until(lambda frame: frame["drawn"] and not frame["loading"])
            yield ctx, tab
        finally:
            viewer.stop()
            browser.terminate()
            browser.wait()


def stepped(tab: Tab) -> tuple[float, float, float]:
    """CPU of a step in time, of sending what it sent, and of sending all of both grids: the least of some."""
    sent: list[tuple[viser.PointCloudHandle, bool]] = []
    draw = Scene._draw_tile

    def noting(scene: Scene, board: Board, side: int, tile: int, reshaped: bool) -> None:
        draw(scene, board, side, tile, reshaped)
        if (handle := scene._tiles.get((side, tile))) is not None:
            sent.append((handle, reshaped))

    taken = []
    for number in range(1, 1 + STEPS):
        sent.clear()
        Scene._draw_tile = noting  # type: ignore[method-assign,assignment]
        step_s = cpu_s(partial(tab.go, NOW + number * 3600.0))
        Scene._draw_tile = draw  # type: ignore[method-assign]
        same_s = cpu_s(partial(send, tab.scene, list(sent)))
        taken.append((step_s, same_s))
    every = [(handle, True) for handle in tab.scene._tiles.values()]
    whole_s = min(cpu_s(partial(send, tab.scene, every)) for _ in range(STEPS))
    return min(step for step, _ in taken), min(same for _, same in taken), whole_s


def seen_at(tab: Tab, at: float) -> None:
    """Show a moment with what was last seen then."""
    tab.go(at)
    tab.until(lambda frame: not frame["loading"])


def send(scene: Scene, tiles: list[tuple[viser.PointCloudHandle, bool]]) -> None:
    """Send as many bytes through viser: other colours, and where cells come or go other points."""
    with scene.client.atomic():
        for handle, reshaped in tiles:
            if reshaped:
                handle.points = handle.points[::-1]
            handle.colors = handle.colors ^ np.uint8(1)
    scene.send(WAIT_S)


def posted(ctx: Context, tab: Tab) -> float:
    """CPU from a live post of four cells in four chunks until it is drawn: the least of some."""
    tab.session.ask(ViewRequest(location=million.NAME, live=True, dim=False))
    tab.until(lambda frame: frame["live"])
    n_cells, taken = prod(million.SHAPE), []
    for number in range(1, 1 + STEPS):
        at = NOW + million.INTERVAL_S * number
        cells = (np.arange(4) * (n_cells // 4) + number).astype(np.uint32)
        body = Body(arrow.write(snapshot(at, cells[:2], cells[2:]).named()), ARROW)

        def post(body: Body = body, at: float = at) -> None:
            observe(ctx, million.NAME, Post(body))
            tab.until(lambda frame: frame["time"] == at)

        taken.append(cpu_s(post))
        time.sleep(0.4)  # news are reported a few times a second
    return min(taken)


def cpu_s(work: Callable[[], object]) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started
