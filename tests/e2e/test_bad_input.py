"""Bodies of a gigabyte, and other things that only a real process can be hurt by."""

import gzip
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache

import httpx
import pytest
import zstandard

from tests.support.here import command
from tests.support.memory import memory_mb, peak_memory_mb
from tests.support.server import ServerProcess, StartServer
from tests.support.site import Site
from tests.support.waiting import WAIT_S

GIGABYTE = 10**9
PART = b"1," * 500_000
LIMIT_MB = 128 * 1.048576
SLACK_MB = 60
"""What a server may take beyond the part of a body that it accepts."""


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> Iterator[Site]:
    with Site(shared_server) as made:
        made.empty_room()
        yield made


def send(port: int, head: str, parts: Iterator[bytes]) -> bytes:
    """A request written to a socket by hand, and the answer's bytes; a sender that is not heeded goes on sending."""
    answer: list[bytes] = []
    with closing(socket.create_connection(("127.0.0.1", port), timeout=60)) as connection:
        connection.sendall(f"{head}\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        reader = threading.Thread(target=lambda: answer.append(read_answer(connection)))
        reader.start()
        try:
            for part in parts:
                connection.sendall(part)
        except OSError:
            pass
        reader.join(WAIT_S)
    return b"".join(answer)


def read_answer(connection: socket.socket) -> bytes:
    """Head and body of one answer."""
    data = b""
    while b"\r\n\r\n" not in data:
        part = connection.recv(1 << 16)
        if not part:
            return data
        data += part
    head, _, body = data.partition(b"\r\n\r\n")
    length = next(int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
    while len(body) < length:
        body += connection.recv(1 << 16)
    return head + b"\r\n\r\n" + body


def declared(path: str) -> tuple[str, Iterator[bytes]]:
    head = f"POST {path} HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: {GIGABYTE}"
    return head, (PART for _ in range(GIGABYTE // len(PART)))


def chunked(path: str) -> tuple[str, Iterator[bytes]]:
    def parts() -> Iterator[bytes]:
        for _ in range(GIGABYTE // len(PART)):
            yield b"%x\r\n%s\r\n" % (len(PART), PART)
        yield b"0\r\n\r\n"

    return f"POST {path} HTTP/1.1\r\nContent-Type: application/json\r\nTransfer-Encoding: chunked", parts()


@pytest.mark.parametrize("way", [declared, chunked])
@pytest.mark.parametrize("path", ["/api/v1/locations/{}/observations", "/api/v1/locations"])
def test_a_gigabyte_is_refused_without_being_held(
    site: Site, shared_server: ServerProcess, path: str, way: object
) -> None:
    room = site.http.get("/locations").json()["items"][0]
    assert callable(way)
    head, parts = way(path.format(room["name"]))
    before = memory_mb(shared_server.process.pid)
    answer = send(shared_server.port, head, parts)
    status, _, body = answer.partition(b"\r\n\r\n")
    assert status.startswith(b"HTTP/1.1 413"), answer[:200]
    assert b"application/problem+json" in status
    problem = json.loads(body)
    assert (problem["status"], problem["type"]) == (413, "urn:tidemap:problem:body-too-large")
    assert peak_memory_mb(shared_server.process.pid) < before + LIMIT_MB + SLACK_MB
    assert site.http.get(f"/locations/{room['name']}").json() == room
    assert site.observe(room["name"], [500], [0])["accepted"] == 1


@pytest.mark.parametrize("encoding", ["gzip", "zstd"])
def test_a_gigabyte_of_zeros_packed_small(site: Site, shared_server: ServerProcess, encoding: str) -> None:
    room = site.http.get("/locations").json()["items"][0]
    before = peak_memory_mb(shared_server.process.pid)
    headers = {"Content-Type": "application/json", "Content-Encoding": encoding}
    answer = site.http.post(f"/locations/{room['name']}/observations", content=bomb(encoding), headers=headers)
    assert answer.status_code == 413
    assert peak_memory_mb(shared_server.process.pid) < before + LIMIT_MB + SLACK_MB
    assert site.http.get(f"/locations/{room['name']}").json() == room


@cache
def bomb(encoding: str) -> bytes:
    member = b"\0" * (GIGABYTE // 100)
    packers: dict[str, Callable[[bytes], bytes]] = {"gzip": gzip.compress, "zstd": zstandard.compress}
    return packers[encoding](member) * 100


def test_without_a_key_not_even_a_small_body_is_read(server: StartServer) -> None:
    running = server(env={"TIDEMAP_VIEWER": "false"})
    command("keys", "create", "--role", "admin", "--data", str(running.data))
    before = peak_memory_mb(running.process.pid)
    for way in (declared, chunked):
        for path in ("/api/v1/locations", "/api/v1/locations/x/observations", "/api/v1/keys"):
            head, parts = way(path)
            some = (part for _, part in zip(range(100), parts, strict=False))
            answer = send(running.port, head, some)
            assert answer.startswith(b"HTTP/1.1 401"), answer[:100]
    assert peak_memory_mb(running.process.pid) < before + SLACK_MB


@pytest.mark.parametrize(
    "request_",
    [
        b"GET /api/v1/locations/%ff%fe HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /api/v1/locations/" + b"x" * 60_000 + b" HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /api/v1/../../etc/passwd HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET //etc/passwd HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /static/../../pyproject.toml HTTP/1.1\r\nHost: x\r\n\r\n",
        b"GET /static/%2e%2e/%2e%2e/pyproject.toml HTTP/1.1\r\nHost: x\r\n\r\n",
        b"NONSENSE\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET /api/v1/locations HTTP/1.1\r\nX: " + b"y" * 200_000 + b"\r\n\r\n",
        b"POST /api/v1/locations HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
        b"POST /api/v1/locations HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n",
    ],
    ids=lambda sent: repr(sent[:40]),
)
def test_odd_requests_get_no_file_and_no_500(site: Site, shared_server: ServerProcess, request_: bytes) -> None:
    with closing(socket.create_connection(("127.0.0.1", shared_server.port), timeout=WAIT_S)) as connection:
        connection.sendall(request_)
        connection.shutdown(socket.SHUT_WR)
        answer = b""
        while part := connection.recv(1 << 16):
            answer += part
    assert answer.split(b" ")[1:2] != [b"200"]
    assert not answer.startswith(b"HTTP/1.1 5")
    assert b"hatchling" not in answer
    assert b"root:" not in answer
    assert site.http.get("/locations").status_code == 200


def test_half_a_request_stores_nothing(site: Site, shared_server: ServerProcess) -> None:
    """A robot out of range in the midst of its post."""
    name = site.empty_room()
    before = site.http.get(f"/locations/{name}").json()
    body = json.dumps({"time": [600], "state": [1]})
    where = f"/api/v1/locations/{name}/observations HTTP/1.1\r\nHost: localhost"
    head = f"POST {where}\r\nContent-Type: application/json\r\n"
    for sent in (f"{head}Content-Length: {len(body) + 1}\r\n\r\n{body}", f"{head}Transfer-Encoding: chunked\r\n\r\n"):
        with closing(socket.create_connection(("127.0.0.1", shared_server.port), timeout=WAIT_S)) as connection:
            connection.sendall(sent.encode())
            time.sleep(0.05)
    time.sleep(0.2)
    assert site.http.get(f"/locations/{name}").json() == before
    assert "Traceback" not in shared_server.output()


def test_other_clients_are_served_while_a_large_body_comes_in(site: Site, shared_server: ServerProcess) -> None:
    head, parts = declared("/api/v1/locations")
    others_served = threading.Event()

    def halting() -> Iterator[bytes]:
        yield next(parts)
        assert others_served.wait(WAIT_S)
        yield from parts

    sender = threading.Thread(target=send, args=(shared_server.port, head, halting()))
    sender.start()
    served = 0
    while sender.is_alive():
        assert httpx.get(f"{shared_server.url}/healthz", trust_env=False, timeout=WAIT_S).status_code == 200
        served += 1
        if served == 20:
            others_served.set()
    sender.join()
    assert served >= 20
