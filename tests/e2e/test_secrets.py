"""No key, session or secret is in a log, an error, an address, a metric or the file of an outbox."""

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.e2e.test_keys import bearer, make_key
from tests.support.here import command
from tests.support.server import StartServer
from tests.support.server_sent import event_source
from tests.support.waiting import WAIT_S
from tidemap.client import Client, RetryPolicy, TidemapError

WRONG = "tm_wrong-and-not-to-be-repeated-anywhere-0123456789"
FORM = {"content-type": "application/x-www-form-urlencoded"}
NOISY = {
    "TIDEMAP_LOG_LEVEL": "debug",
    "TIDEMAP_LOG_FORMAT": "json",
    "TIDEMAP_ACCESS_LOG": "true",
    "TIDEMAP_WRONG_KEYS_PER_MINUTE": "8",
    "TIDEMAP_WEBHOOKS_PRIVATE": "true",
}


class Visitor:
    """Asks, and keeps all that it is answered, heads included."""

    def __init__(self, url: str) -> None:
        self.http = httpx.Client(base_url=url, trust_env=False, timeout=WAIT_S)
        self.said: list[str] = []

    def ask(self, method: str, path: str, key: str = "", **how: Any) -> httpx.Response:
        headers = {**(bearer(key) if key else {}), **how.pop("headers", {})}
        answer = self.http.request(method, path, headers=headers, **how)
        heads = [f"{name}: {value}" for name, value in answer.headers.items() if name != "set-cookie"]
        self.said += [str(answer.url), *heads, answer.text]
        return answer


def misbehave(visitor: Visitor, port: int, keys: dict[str, str]) -> None:
    """Ask in all the ways that are refused, with every key."""
    for key in (WRONG, *keys.values()):
        for path in ("/api/v1/locations", "/api/v1/keys", "/api/v1/audit", "/metrics", "/", "/view/", "/readyz"):
            visitor.ask("GET", path, key)
        visitor.ask("POST", "/api/v1/locations", key, content=b"{", headers={"content-type": "application/json"})
        visitor.ask("POST", "/api/v1/locations", key, json={"name": "x", "nonsense": 1})
        visitor.ask("PATCH", "/api/v1/locations/none", key, json={"confidence": 2})
        visitor.ask("DELETE", "/api/v1/keys/99", key)
        visitor.ask("BREW", "/api/v1/locations", key)
        visitor.ask("POST", "/login", content=f"key={key}&next=//evil".encode(), headers=FORM)
        visitor.ask("POST", "/login", content=f"key={key}".encode(), headers={**FORM, "origin": "http://evil.example"})
        visitor.http.cookies.clear()
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{port}/api/v1/events", additional_headers=bearer(WRONG), proxy=None)
    connect(f"ws://127.0.0.1:{port}/api/v1/events", additional_headers=bearer(keys["operator"]), proxy=None).close()


def outbox_of(url: str, key: str, file: Path) -> str:
    """What a client says whose posts are refused, with a file that keeps them."""
    with Client(url, key=key, outbox=file, retry=RetryPolicy(tries=1)) as client:
        client.location("none").observe(time=[0.0], state=[1])
        try:
            client.locations()
        except TidemapError as error:
            return f"{error!r} {error}"
    return ""


def test_secrets_are_nowhere(server: StartServer, tmp_path: Path) -> None:
    running = server(env=NOISY)
    where = ("--data", str(running.data))
    keys = {role: str(make_key(where, role)["key"]) for role in ("admin", "robot", "operator")}
    visitor = Visitor(running.url)
    secrets = {WRONG, *keys.values()}
    visitor.ask("POST", "/api/v1/locations", keys["admin"], json={"name": "door", "interval_s": 60})
    visitor.ask("POST", "/api/v1/locations/door/observations", keys["robot"], json={"time": [0], "state": [1]})
    hook = visitor.http.post("/api/v1/webhooks", headers=bearer(keys["admin"]), json={"url": "http://127.0.0.1:9/x"})
    secrets.add(hook.json()["secret"])
    visitor.ask("POST", f"/api/v1/webhooks/{hook.json()['id']}/test", keys["admin"])
    made = visitor.http.post("/api/v1/keys", headers=bearer(keys["admin"]), json={"name": "n", "role": "robot"})
    secrets.add(made.json()["key"])
    signed_in = visitor.http.post("/login", content=f"key={keys['operator']}".encode(), headers=FORM)
    secrets.add(signed_in.cookies["tidemap_session"])
    visitor.ask("GET", "/locations/door")
    with event_source(running.url, headers=bearer(keys["operator"])):
        pass
    misbehave(visitor, running.port, keys)
    said = [outbox_of(running.url, key, tmp_path / f"{n}.outbox") for n, key in enumerate((WRONG, keys["robot"]))]
    for words in (("locations", "list"), ("update", "none"), ("export", "none", "--format", "ply")):
        done = command(*words, "--url", running.url, "--key", WRONG)
        said += [done.stdout, done.stderr]
    visitor.http.close()
    assert running.stop() == 0

    lines = [line for line in running.output().splitlines() if line.startswith("{")]
    paths = [json.loads(line).get("path") for line in lines]
    assert len(paths) > 60, "the access log is on"
    files = [path.read_bytes() for path in (*tmp_path.glob("*.outbox*"), *running.data.glob("*")) if path.is_file()]
    assert len(files) >= 4
    everything = [running.output().encode(), *map(str.encode, (*visitor.said, *said)), *files]
    for secret in map(str.encode, secrets):
        leaks = [text[max(0, text.index(secret) - 200) :][:400] for text in everything if secret in text]
        assert not leaks, secret
