"""Bodies up to the limit and beyond it; what is packed counts unpacked."""

import gzip
import json
import tracemalloc
from collections.abc import AsyncIterator, Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import zstandard

from tests.api.house import ARROW, HOUR, JSON, NOW, Api, arrow, done, open_house, problem

LIMIT = 2**20
PACK: dict[str, Callable[[bytes], bytes]] = {"gzip": gzip.compress, "zstd": zstandard.compress}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Api]:
    """A site that takes bodies of a mebibyte, with a door."""
    with open_house(tmp_path_factory.mktemp("small"), max_body_bytes=LIMIT) as api:
        api.location(name="door")
        yield api


def sized(length: int) -> bytes:
    """A good post of this length."""
    return json.dumps({"time": [NOW - 60], "state": [1]}).encode().ljust(length)


async def streamed(content: bytes, step: int = 10_000) -> AsyncIterator[bytes]:
    """The content without a Content-Length."""
    for start in range(0, len(content), step):
        yield content[start : start + step]


@pytest.mark.parametrize("encoding", ["gzip", "zstd", None])
def test_a_body_may_be_as_long_as_the_limit_and_no_longer(small: Api, encoding: str | None) -> None:
    headers = {"Content-Type": JSON, **({"Content-Encoding": encoding} if encoding else {})}
    pack = PACK.get(encoding or "", bytes)
    before = small.facts("door")["observations"]
    done(small.post("/locations/door/observations", content=pack(sized(LIMIT)), headers=headers), 201)
    found = problem(
        small.post("/locations/door/observations", content=pack(sized(LIMIT + 1)), headers=headers),
        413,
        "body-too-large",
    )
    assert str(LIMIT) in found["detail"]
    assert "Split" in found["detail"]
    assert small.facts("door")["observations"] == before + 1


def test_json_has_a_limit_of_its_own(tmp_path: Path) -> None:
    """As it takes more memory and time than arrays of the same length."""
    with open_house(tmp_path, max_json_bytes=1000) as api:
        api.location(name="door")
        times = NOW - HOUR * np.arange(200)
        path, table = "/locations/door/observations", arrow({"time": times, "state": np.zeros(200, np.uint8)})
        assert len(table) > 1000
        done(api.post(path, content=table, headers={"Content-Type": ARROW}), 201)
        refused = api.post(path, content=sized(1001), headers={"Content-Type": JSON})
        assert "1000" in problem(refused, 413, "body-too-large")["detail"]


def test_the_length_need_not_be_declared(small: Api) -> None:
    headers = {"Content-Type": JSON}
    path = "/locations/door/observations"
    done(small.post(path, content=streamed(sized(LIMIT)), headers=headers), 201)
    problem(small.post(path, content=streamed(sized(LIMIT + 1)), headers=headers), 413, "body-too-large")
    problem(small.post("/locations", content=streamed(sized(3 * LIMIT)), headers=headers), 413, "body-too-large")


UNPACKED = 100 * LIMIT


@cache
def bomb(kind: str) -> bytes:
    """Zeros, packed."""
    part = b"\0" * LIMIT
    return {
        "gzip": lambda: gzip.compress(part * 100, 1),
        "gzip-members": lambda: gzip.compress(part) * 100,
        "zstd": lambda: zstandard.compress(part * 100),
        "zstd-frames": lambda: zstandard.compress(part) * 100,
    }[kind]()


@pytest.mark.parametrize("kind", ["gzip", "gzip-members", "zstd", "zstd-frames"])
@pytest.mark.parametrize("path", ["/locations/door/observations", "/locations"])
def test_a_bomb_is_noticed_while_it_is_small(small: Api, path: str, kind: str) -> None:
    content = bomb(kind)
    assert len(content) < LIMIT
    headers = {"Content-Type": JSON, "Content-Encoding": kind.partition("-")[0]}
    tracemalloc.start()
    try:
        problem(small.post(path, content=content, headers=headers), 413, "body-too-large")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < UNPACKED / 2


@pytest.mark.parametrize(("log", "status"), [(23, 201), (24, 400)])
def test_the_window_of_zstd_is_bounded(small: Api, log: int, status: int) -> None:
    parameters = zstandard.ZstdCompressionParameters(window_log=log)
    packer = zstandard.ZstdCompressor(compression_params=parameters).compressobj()
    content = packer.compress(sized(5000)) + packer.flush()
    headers = {"Content-Type": JSON, "Content-Encoding": "zstd"}
    answer = small.post("/locations/door/observations", content=content, headers=headers)
    assert answer.status_code == status, answer.text


def test_a_bomb_inside_of_arrow_is_not_unpacked(small: Api) -> None:
    """Arrow can pack its buffers by itself, behind the limit of a body."""
    columns = {"time": np.zeros(20_000_000), "state": np.zeros(20_000_000, np.uint8)}
    for compression in ("zstd", "lz4"):
        content = arrow(columns, compression=compression)
        assert len(content) < LIMIT
        answer = small.post("/locations/door/observations", content=content, headers={"Content-Type": ARROW})
        assert "compression" in problem(answer, 400, "unreadable-body")["detail"]


@pytest.mark.parametrize("encoding", PACK)
@pytest.mark.parametrize("spoil", ["cut", "flipped", "nothing", "followed"])
def test_packed_bodies_that_are_broken(small: Api, encoding: str, spoil: str) -> None:
    good = PACK[encoding](sized(5000))
    middle = len(good) // 2
    content = {
        "cut": good[:-5],
        "flipped": good[:middle] + bytes([good[middle] ^ 0xFF]) + good[middle + 1 :],
        "nothing": b"",
        "followed": good + b"more",
    }[spoil]
    before = small.facts("door")
    headers = {"Content-Type": JSON, "Content-Encoding": encoding}
    answer = small.post("/locations/door/observations", content=content, headers=headers)
    found = problem(answer, 400, "unreadable-body")
    # Without a checksum zstd cannot tell that it was given something else.
    assert "compressed" in found["detail"] or (encoding, spoil) == ("zstd", "flipped")
    assert small.facts("door") == before


def test_a_sender_that_waits_to_be_asked_sends_nothing_in_vain(small: Api) -> None:
    async def body() -> AsyncIterator[bytes]:
        raise AssertionError("the body was read")
        yield b""  # type: ignore[unreachable]

    headers = {"Content-Type": JSON, "Content-Length": str(10 * LIMIT), "Expect": "100-continue"}
    problem(small.post("/locations/door/observations", content=body(), headers=headers), 413)
