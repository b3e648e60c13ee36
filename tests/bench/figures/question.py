"""question: CPU of a server for the whole state of 10^6 cells as Arrow by HTTP, against the same bytes from memory.

The value is given the model alone; `given` is given the cells' last readings, of eight looks at all of them, `observed`
with what was last seen beside, each with its floor: as many bytes from memory.
"""

import tempfile
from functools import partial
from math import prod
from pathlib import Path

import httpx
import numpy as np

from tests.bench import databases
from tests.bench.load import Target, floor_server, request
from tests.bench.timing import Figure, quantile
from tests.support.contexts import opened
from tests.support.server import ServerProcess
from tidemap.client import arrow
from tidemap.client.encoding import snapshot
from tidemap.formats.registry import Body
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.timebase import TimeBase
from tidemap.media_types import ARROW
from tidemap.services.context import Context
from tidemap.services.locations import NewLocation, create_location, find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Post
from tidemap.services.spectra import fitted
from tidemap.space.grid import GridGeometry
from tidemap.spectral.prediction import predict
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import RevisionRecord
from tidemap.storage.work import Work

NAME, SHAPE, EVERY, ORDER, WEEK_S = "hall", (200, 200, 25), 10, 15, 604_800.0
ENVIRONMENT = {"TIDEMAP_UPDATER": "false", "TIDEMAP_VIEWER": "false", "TIDEMAP_LOG_LEVEL": "warning"}
QUESTIONS, ROUNDS, LOOKS = 100, 5, 8
HOW = {"model": "given=model", "given": "given=observations", "observed": "given=observations&observed=true"}


def measure(shape: tuple[int, ...] = SHAPE, questions: int = QUESTIONS) -> Figure:
    with databases.sqlite() as url, tempfile.TemporaryDirectory(prefix="tidemap-bench-") as folder:
        with opened(url) as ctx:
            prepare(ctx, shape)
            look(ctx)
        server = ServerProcess(Path(folder), database_url=url, env=ENVIRONMENT)
        try:
            with floor_server() as floor:
                return _measure(server, floor, questions)
        finally:
            server.stop()


def prepare(ctx: Context, shape: tuple[int, ...]) -> None:
    """A location with a revision: a tenth of its cells have 15 components of a week, the others a mean."""
    grid = GridGeometry("map", (0.0, 0.0, 0.0), 0.1, shape)
    create_location(ctx, NewLocation(name=NAME, kind="grid3d", interval_s=300.0, estimator="fft", order=15, grid=grid))
    location = find_location(ctx, NAME)
    random = np.random.default_rng(2)
    for chunk, first in enumerate(range(0, prod(shape), CHUNK_CELLS)):
        part = some(random, min(CHUNK_CELLS, prod(shape) - first))
        ctx.store.write(partial(put, location.id, chunk, part))
    record = RevisionRecord(location.id, 1, Recipe("fft", ORDER, "UTC"), 0, 2016, 0, 0, None, 0.0, None)
    ctx.store.write(lambda work: work.spectra.publish(record))


def put(location_id: int, chunk: int, part: Spectrum, work: Work) -> None:
    """Store a chunk of the revision."""
    work.spectra.put_chunk(location_id, 1, chunk, part)


def some(random: np.random.Generator, n_cells: int) -> Spectrum:
    """The spectrum of some cells."""
    cell = np.arange(0, n_cells, EVERY, dtype=np.int32)
    parts = random.standard_normal((cell.size, ORDER, 2), np.float32) * np.float32(0.05)
    return Spectrum(
        link="identity",
        origin_s=0.0,
        time_zone=None,
        frequency_hz=np.arange(1, 1009) / WEEK_S,
        gate=np.zeros(1008, np.uint8),
        mean=random.random(n_cells, np.float32),
        cell=cell,
        index=random.integers(0, 1008, (cell.size, ORDER), np.uint16),
        coefficient=parts.view(np.complex64)[:, :, 0],
        base=TimeBase(0.0, 1.0),
    )


def look(ctx: Context, looks: int = LOOKS) -> None:
    """Read every cell some times, as it is expected."""
    spectrum = fitted(ctx, NAME).spectrum
    for time in 300.0 * np.arange(looks):
        occupied = predict(spectrum, time) > 0.5
        seen = snapshot(time, *(np.flatnonzero(each).astype(np.uint32) for each in (occupied, ~occupied)))
        observe(ctx, NAME, Post(Body(arrow.write(seen.named()), ARROW)))


def _measure(server: ServerProcess, floor: Target, questions: int) -> Figure:
    target = Target(server.process.pid, server.port)
    pairs = {name: _pair(server, how) for name, how in HOW.items()}
    everyone = [(floor, least) for least, _ in pairs.values()] + [(target, asked) for _, asked in pairs.values()]
    rounds = [[each.serve(_asked(path, questions), 1) for each, path in everyone] for _ in range(ROUNDS)]
    cheapest = [min(served.cpu_s for served in column) * 1e3 for column in zip(*rounds, strict=True)]
    floors, values = dict(zip(HOW, cheapest, strict=False)), dict(zip(HOW, cheapest[len(HOW) :], strict=True))
    latency = [seconds for served in rounds for seconds in served[len(HOW)].latency_s]
    details: dict[str, float | int | str] = {
        "bytes": int(pairs["model"][0].strip("/")),
        "p50_ms": round(quantile(latency, 0.5) * 1e3, 1),
        "p99_ms": round(quantile(latency, 0.99) * 1e3, 1),
    }
    for name in ("given", "observed"):
        details |= {f"{name}_ms": round(values[name], 2), f"{name}_floor_ms": round(floors[name], 2)}
    return Figure(values["model"], floors["model"], 2.0, "ms CPU/question", details)


def _pair(server: ServerProcess, how: str) -> tuple[str, str]:
    """The floor's path and the server's for one kind of question, whose `time` is left open."""
    path = f"/api/v1/locations/{NAME}/state?{how}&time={{}}"
    answer = httpx.get(server.url + path.format(1e6), headers={"accept": ARROW}, trust_env=False, timeout=60)
    answer.raise_for_status()
    return f"/{len(answer.content)}", path


def _asked(path: str, questions: int) -> list[bytes]:
    return [request("GET", path.format(1e6 + 777 * i), accept=ARROW) for i in range(questions)]
