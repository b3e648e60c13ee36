"""Signing in with what is no key, or too often: people get a page, whatever is wrong."""

import httpx
import pytest

from tests.e2e.test_keys import make_key
from tests.support.server import ServerProcess, StartServer

FORM = {"content-type": "application/x-www-form-urlencoded"}
GARBAGE = {"content-type": "multipart/form-data; boundary=x"}


@pytest.fixture(scope="module")
def keyed(module_server: StartServer) -> tuple[ServerProcess, str]:
    """A server with an operator's key, that looks at three wrong keys a minute."""
    env = {"TIDEMAP_VIEWER": "false", "TIDEMAP_WRONG_KEYS_PER_MINUTE": "3"}
    running = module_server(env=env)
    return running, str(make_key(("--data", str(running.data)), "operator")["key"])


def send(server: ServerProcess, content: bytes, headers: dict[str, str]) -> httpx.Response:
    return httpx.post(f"{server.url}/login", content=content, headers=headers, trust_env=False)


@pytest.mark.parametrize(
    ("content", "headers", "status"),
    [
        (b"--x\r\ngarbage", GARBAGE, 415),
        (b"", {}, 415),
        (b"", FORM, 400),
        (b"next=/", FORM, 400),
        (b"key", FORM, 400),
        (b"\xff\xfe", FORM, 400),
        (b"key=%FF%FE", FORM, 400),
        (b"&".join(b"k%d=1" % n for n in range(50)), FORM, 400),
        (b"key=" + b"x" * 20_000, FORM, 413),
        (b"key=tm_x", FORM | {"origin": "http://evil.example"}, 403),
    ],
)
def test_what_is_no_form_is_told_on_the_form(
    keyed: tuple[ServerProcess, str], content: bytes, headers: dict[str, str], status: int
) -> None:
    answer = send(keyed[0], content, headers)
    assert answer.status_code == status
    assert answer.headers["content-type"].startswith("text/html")
    assert 'name="key"' in answer.text
    assert 'aria-invalid="true"' in answer.text


def test_too_many_wrong_keys_are_told_on_the_form_and_a_right_one_gets_in(keyed: tuple[ServerProcess, str]) -> None:
    server, key = keyed
    right = send(server, f"key={key}&next=%2Flocations%2Fdoor".encode(), FORM)
    assert (right.status_code, right.headers["location"]) == (303, "/locations/door")
    answers = [send(server, b"key=tm_wrong%d" % n, FORM) for n in range(8)]
    assert {answer.status_code for answer in answers} == {401, 429}
    last = answers[-1]
    assert last.status_code == 429
    assert int(last.headers["retry-after"]) > 0
    assert last.headers["content-type"].startswith("text/html")
    assert send(server, f"key={key}".encode(), FORM).status_code == 303, "a right key goes on"


def test_pages_say_that_requests_are_too_many(server: StartServer) -> None:
    env = {"TIDEMAP_VIEWER": "false", "TIDEMAP_REQUESTS_PER_S": "0.01", "TIDEMAP_REQUESTS_BURST": "2"}
    running = server(env=env)
    key = make_key(("--data", str(running.data)), "operator")["key"]
    headers = {"Authorization": f"Bearer {key}"}
    pages = [httpx.get(f"{running.url}/", headers=headers, trust_env=False) for _ in range(4)]
    assert pages[-1].status_code == 429
    assert pages[-1].headers["content-type"].startswith("text/html")
