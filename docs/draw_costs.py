"""The picture of docs/scaling.md: how what things cost grows with what there is of them. `python -m docs.draw_costs`.

Each curve is measured over two decades, in processor seconds, the least of some, so that other work on the machine
counts little; the numbers are printed, a JSON line a curve. It takes some minutes. `python -m docs.draw_costs FILE`
draws what was printed before.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from docs.paper.style import OBSERVED, OUTLIER, PREDICTED, THRESHOLDED, drawing
from tests.bench import lab, million
from tests.bench.databases import sqlite
from tests.bench.figures.fleet import serving
from tests.bench.figures.viewer import stepped, watched
from tests.bench.traffic import Load, Tally, Traffic
from tests.support.contexts import Clock, opened, refit
from tests.support.paths import ROOT
from tidemap.formats.registry import Body
from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.state import StateQuery, state_at
from tidemap.spectral.model import update

PICTURE = ROOT / "docs" / "images" / "costs.png"
BASE = TimeBase(epoch=0.0, interval_s=300.0)
COLORS = [THRESHOLDED] * 3 + [PREDICTED] * 3 + [OUTLIER] * 2
ROUNDS, TRAFFIC_S, N_CELLS, N_SAMPLES, ORDER = 5, 20.0, 1024, 2016, 15


@dataclass(frozen=True, slots=True)
class Curve:
    """What was counted, how many of it, and milliseconds of processor time for each."""

    name: str
    unit: str
    counts: Sequence[float]
    cost_ms: Sequence[float]


def cpu_ms(work: Callable[[], object], rounds: int = ROUNDS) -> float:
    """The least of some, after one that does not count."""
    work()
    taken = []
    for _ in range(rounds):
        started = time.process_time()
        work()
        taken.append(time.process_time() - started)
    return 1e3 * min(taken)


def curve(name: str, unit: str, counts: Sequence[float], cost_ms: Callable[[int], float]) -> Curve:
    """One curve, printed when it is known."""
    found = Curve(name, unit, counts, [cost_ms(int(each)) for each in counts])
    said = {"curve": name, unit: list(found.counts), "ms": [float(f"{each:.3g}") for each in found.cost_ms]}
    sys.stdout.write(json.dumps(said) + "\n")
    sys.stdout.flush()
    return found


def updates() -> Iterator[Curve]:
    """An update of cells that all change."""
    yield curve("update", "cells", [100, 1000, 10_000], lambda some: fitted(some, N_SAMPLES, ORDER))
    yield curve("update", "samples", [200, 2000, 20_000], lambda some: fitted(N_CELLS, some, ORDER))
    yield curve("update", "order", [1, 8, 64], lambda some: fitted(N_CELLS, N_SAMPLES, some))


def fitted(n_cells: int, n_samples: int, order: int) -> float:
    """Milliseconds of a fit, outliers included."""
    random = np.random.default_rng(1)
    hour = (np.arange(n_samples) / 12) % 24
    begin = random.uniform(0, 24, (n_cells, 1))
    states = ((hour - begin) % 24 < 8).astype(np.uint8) ^ (random.random((n_cells, n_samples), np.float32) < 0.05)
    history = History.from_states(states)
    return cpu_ms(lambda: update(history, "fft", order, BASE))


def services() -> Iterator[Curve]:
    """Posts and questions, in process, on a laboratory and on halls."""
    with sqlite() as url, opened(url, Clock(lab.now())) as ctx:
        lab.prepare(ctx)
        yield curve("post", "cells", [100, 1000, 10_000], lambda some: posted(ctx, some))
    yield curve("question", "cells", [1000, 10_000, 100_000], asked)
    yield curve("step in a viewer", "cells", [1000, 10_000, 100_000], viewed)


def posted(ctx: Context, n_cells: int) -> float:
    """Milliseconds of a post, its share of a commit of its own included."""
    bodies = iter([Body(lab.seen(ctx.clock() - 2.0 * back, n_cells), ARROW) for back in range(10 * ROUNDS)])
    return cpu_ms(lambda: observe(ctx, lab.NAME, Post(next(bodies))), 9 * ROUNDS)


def asked(n_cells: int) -> float:
    """Milliseconds of a question for all of a hall."""
    with sqlite() as url, opened(url) as ctx:
        million.make(ctx, (n_cells // 100, 10, 10), estimator="fft")
        refit(ctx, million.NAME)
        times = count()
        return cpu_ms(lambda: state_at(ctx, million.NAME, StateQuery(million.TIME[-1] + 60.0 * next(times))))


def viewed(n_cells: int) -> float:
    """Milliseconds of a step in time in an open viewer, computed and sent."""
    with watched((n_cells // 100, 10, 10)) as (_, tab):
        return 1e3 * stepped(tab)[0]


def fleets() -> Iterator[Curve]:
    """Posts by the number of robots, and the same for every viewer that is open."""
    with serving() as (server, file):
        one = Load(server, file, [f"{lab.NAME}-0"])
        one.run(Traffic(robots=10, viewers=1), 5.0)
        idle = one.run(Traffic(), TRAFFIC_S)

        def more_ms(tally: Tally) -> float:
            return 1e3 * (tally.cpu_s - idle.cpu_s * tally.seconds / idle.seconds)

        def post_ms(robots: int) -> float:
            tally = one.run(Traffic(robots=robots), TRAFFIC_S)
            return more_ms(tally) / tally.done["post"]

        alone_ms = post_ms(10)

        def viewer_ms(viewers: int) -> float:
            tally = one.run(Traffic(robots=10, viewers=viewers), TRAFFIC_S)
            return more_ms(tally) / tally.done["post"] - alone_ms

        yield curve("post over HTTP, each of", "robots", [1, 10, 100], post_ms)
        yield curve("a post, drawn in", "viewers", [1, 3, 10], viewer_ms)


def draw(curves: Sequence[Curve]) -> None:
    """One panel a curve, both axes logarithmic; the grey line is proportional."""
    with drawing(PICTURE, 5.6) as figure:
        for axes, each, color in zip(figure.subplots(2, -(-len(curves) // 2)).flat, curves, COLORS, strict=False):
            last = each.cost_ms[-1] / each.counts[-1]
            axes.loglog(each.counts, [last * some for some in each.counts], color=OBSERVED, linewidth=1.0)
            axes.loglog(each.counts, each.cost_ms, color=color, marker="o")
            axes.set_ylim(min(each.cost_ms) / 5, max(each.cost_ms) * 5)
            axes.set_title(each.name, fontsize=10)
            axes.set_xlabel(each.unit)
        for axes in figure.axes[:: len(figure.axes) // 2]:
            axes.set_ylabel("ms of CPU")


def read(file: Path) -> Iterator[Curve]:
    """Curves that were printed."""
    for line in file.read_text().splitlines():
        said = json.loads(line)
        (unit,) = said.keys() - {"curve", "ms"}
        yield Curve(said["curve"], unit, said[unit], said["ms"])


def main(files: Sequence[str]) -> None:
    """Measure, or read, and draw."""
    draw([*read(Path(files[0]))] if files else [*updates(), *services(), *fleets()])


if __name__ == "__main__":
    main(sys.argv[1:])
