"""Large answers over a real socket: what is on its way to one who asks is not written for another, and comes back."""

import json
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from threading import Thread

import httpx
import numpy as np
import pyarrow as pa
import pytest
import uvicorn

from tests.api.house import ARROW
from tests.support.contexts import make_location, opened
from tests.support.databases import migrate_to_head
from tests.support.waiting import until
from tidemap.history.chunks import CHUNK_CELLS
from tidemap.history.timebase import TimeBase
from tidemap.server.census import Census
from tidemap.server.processes import all_in_one
from tidemap.server.serving import configure
from tidemap.services.context import Context
from tidemap.services.locations import find_location
from tidemap.services.state import StateQuery, state_at
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum
from tidemap.storage.records import RevisionRecord
from tidemap.storage.work import Work
from tidemap_web.site import pages

SIDE = 1000
"""The answer has 10 MB, more than the sockets of both ends hold."""


@pytest.fixture(scope="module")
def ctx(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Context]:
    """A million cells, every fiftieth with a wave."""
    url = f"sqlite:///{tmp_path_factory.mktemp('hall') / 'tidemap.db'}"
    migrate_to_head(url)
    with opened(url, viewer=False) as ctx:
        make_location(ctx, "hall", (SIDE, SIDE), confidence=0.75)
        location = find_location(ctx, "hall")
        for chunk in range(location.n_chunks):
            spectrum = waving(chunk, location.chunk_size(chunk))
            ctx.store.submit(partial(put_chunk, location.id, chunk, spectrum))
        record = RevisionRecord(location.id, 1, Recipe("fft", 1, "UTC"), 0, 2016, 0, 0, None, 0.0, None)
        ctx.store.write(lambda work: work.spectra.publish(record))
        yield ctx


def put_chunk(location_id: int, chunk: int, spectrum: Spectrum, work: Work) -> None:
    work.spectra.put_chunk(location_id, 1, chunk, spectrum)


def waving(seed: int, n_cells: int) -> Spectrum:
    cell = np.arange(0, n_cells, CHUNK_CELLS // 20, dtype=np.int32)
    return Spectrum(
        link="identity",
        origin_s=0.0,
        time_zone=None,
        frequency_hz=np.array([1 / 86_400.0]),
        gate=np.zeros(1, np.uint8),
        mean=np.random.default_rng(seed).random(n_cells, np.float32),
        cell=cell,
        index=np.zeros((cell.size, 1), np.uint16),
        coefficient=np.full((cell.size, 1), 0.2, np.complex64),
        base=TimeBase(0.0, 1.0),
    )


@pytest.fixture(scope="module")
def port(ctx: Context) -> Iterator[int]:
    """A server in this process, so that it can be seen who has what."""
    with all_in_one(ctx, pages) as site, socket.create_server(("127.0.0.1", 0)) as bound:
        server = uvicorn.Server(configure(site, "127.0.0.1", 0, Census(10, 10)))
        thread = Thread(target=server.run, args=([bound],))
        thread.start()
        yield bound.getsockname()[1]
        server.should_exit = True
        thread.join()


@contextmanager
def asking(port: int, time: float) -> Iterator[socket.socket]:
    """A connection on which the question has been sent, and which takes little of the answer before it is read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        connection.settimeout(30)
        connection.connect(("127.0.0.1", port))
        head = f"GET /api/v1/locations/hall/state?time={time}&given=model HTTP/1.1\r\nhost: localhost\r\n"
        connection.sendall(f"{head}accept: {ARROW}\r\nconnection: close\r\n\r\n".encode())
        yield connection


def checked(ctx: Context, body: bytes, time: float) -> None:
    """The answer is that of this time."""
    with pa.ipc.open_stream(body) as reader:
        table = reader.read_all()
    view = state_at(ctx, "hall", StateQuery(time))
    assert json.loads(table.schema.metadata[b"tidemap"])["revision"] == 1
    np.testing.assert_array_equal(table["cell"].to_numpy(), view.cell)
    np.testing.assert_array_equal(table["probability"].to_numpy(), view.probability)
    np.testing.assert_array_equal(table["state"].to_numpy(), view.state)
    np.testing.assert_array_equal(table["verdict"].combine_chunks().indices.to_numpy(), view.verdict)


def ask(port: int, time: float) -> bytes:
    path = f"http://127.0.0.1:{port}/api/v1/locations/hall/state?time={time}&given=model"
    return httpx.get(path, headers={"accept": ARROW}, trust_env=False, timeout=60).raise_for_status().content


def lent(ctx: Context) -> int:
    """How many sheets somebody has."""
    return sum(not item.free for shelf in ctx.caches.buffers._shelves.values() for item in shelf.items)


def test_who_reads_slowly_gets_what_was_asked_for_while_others_ask(ctx: Context, port: int) -> None:
    with asking(port, 3600.0) as slow:
        received = bytearray(slow.recv(1000))
        until(lambda: lent(ctx) == 1)
        times = [7200.0 * n for n in range(1, 7)]
        with ThreadPoolExecutor(3) as pool:
            for time, body in zip(times, pool.map(lambda time: ask(port, time), times), strict=True):
                checked(ctx, body, time)
        until(lambda: lent(ctx) == 1)
        while part := slow.recv(1 << 20):
            received += part
    head, _, body = bytes(received).partition(b"\r\n\r\n")
    assert f"content-length: {len(body)}".encode() in head.lower()
    checked(ctx, body, 3600.0)
    until(lambda: lent(ctx) == 0)


def test_who_hangs_up_gives_the_memory_back(ctx: Context, port: int) -> None:
    for n in range(12):
        with asking(port, 3600.0 * n) as hasty:
            assert hasty.recv(1000).startswith(b"HTTP/1.1 200")
            assert lent(ctx) >= 1
    until(lambda: lent(ctx) == 0)
    made = sum(len(shelf.items) for shelf in ctx.caches.buffers._shelves.values())
    checked(ctx, ask(port, 60.0), 60.0)
    assert sum(len(shelf.items) for shelf in ctx.caches.buffers._shelves.values()) == made
    assert ctx.caches.buffers.n_bytes <= ctx.settings.answer_cache_bytes
