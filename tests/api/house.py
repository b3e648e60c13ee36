"""The site in this process, on a database of its own, with a clock that stands still."""

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
from anyio.from_thread import BlockingPortal, start_blocking_portal
from fastapi import FastAPI

from tidemap.api.main import create_app
from tidemap.server.processes import all_in_one
from tidemap.services.context import Context, open_context
from tidemap.settings import Settings
from tidemap.storage.store import prepare_database
from tidemap_web.site import pages

NOW = 1772409600.0
"""Monday, 2 March 2026, 00:00 UTC."""
DAY = 86400.0
HOUR = 3600.0
BASE = "/api/v1"
ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"
NPY = "application/x-npy"
PROBLEM = "application/problem+json"
GRID = {"frame": "map", "origin": [10.0, 20.0, 0.0], "resolution_m": 0.5, "shape": [4, 3, 2]}
"""24 cells."""


@dataclass
class Clock:
    """The server's clock, moved by hand."""

    now: float = NOW

    def __call__(self) -> float:
        return self.now


class Http:
    """Sends requests straight to the application, whose event loop runs in a thread of its own."""

    def __init__(self, portal: BlockingPortal, site: FastAPI) -> None:
        transport = httpx.ASGITransport(site, raise_app_exceptions=False)
        self.portal = portal
        self._client = httpx.AsyncClient(transport=transport, base_url="http://localhost")

    def request(self, method: str, path: str, **how: Any) -> httpx.Response:
        answer = self.portal.call(partial(self._client.request, method, path, **how))
        if answer.headers.get("content-type") == PROBLEM:
            check_described(answer)
        return answer

    def raw(self, method: str, path: str, **how: Any) -> httpx.Response:
        """As `request`, but a compressed answer is left as it came."""
        return self.portal.call(partial(self._raw, method, path, **how))

    async def _raw(self, method: str, path: str, **how: Any) -> httpx.Response:
        async with self._client.stream(method, path, **how) as answer:
            content = b"".join([part async for part in answer.aiter_raw()])
        kept = httpx.Response(answer.status_code, headers=answer.headers, request=answer.request)
        kept._content = content
        return kept

    def sign_in(self, secret: str) -> None:
        """Send this key from now on."""
        self._client.headers["Authorization"] = f"Bearer {secret}"


@dataclass
class Api:
    """The API as a client sees it, and the context behind it."""

    ctx: Context
    http: "Http"
    clock: Clock
    _numbers: Iterator[int] = field(default_factory=lambda: count(1))

    def get(self, path: str, **how: Any) -> httpx.Response:
        return self.request("GET", path, **how)

    def post(self, path: str, form: object = None, **how: Any) -> httpx.Response:
        return self.request("POST", path, **({"json": form} if form is not None else {}), **how)

    def patch(self, path: str, form: object) -> httpx.Response:
        return self.request("PATCH", path, json=form)

    def delete(self, path: str) -> httpx.Response:
        return self.request("DELETE", path)

    def request(self, method: str, path: str, **how: Any) -> httpx.Response:
        return self.http.request(method, BASE + path, **how)

    def name(self, kind: str = "location") -> str:
        """A name that no other test has."""
        return f"{kind}-{next(self._numbers)}"

    def location(self, **settings: Any) -> str:
        """A new location of kind `state` with samples of an hour; its name."""
        form = {"name": self.name(), "interval_s": HOUR, **settings}
        return str(done(self.post("/locations", form), 201)["name"])

    def lab(self, **settings: Any) -> str:
        """A new grid of 24 cells; its name."""
        return self.location(kind="grid3d", **{"grid": GRID, **settings})

    def observe(self, name: str, time: Any, state: Any, **how: Any) -> Any:
        """Post measurements of a `state`; the answer."""
        form = {"time": np.asarray(time).tolist(), "state": np.asarray(state).tolist()}
        return done(self.post(f"/locations/{name}/observations", form, **how), 201)

    def look(self, name: str, *looks: tuple[float, list[Any], list[Any]]) -> Any:
        """Post observations (time, occupied, free) of a grid; the answer."""
        form = [{"time": time, "occupied": occupied, "free": free} for time, occupied, free in looks]
        return done(self.post(f"/locations/{name}/observations", {"observations": form}), 201)

    def update(self, name: str, **form: Any) -> Any:
        """Refit a location; the finished job."""
        job = done(self.post(f"/locations/{name}/update?wait=60", form), 200)
        assert job["state"] == "done", job
        return job

    def facts(self, name: str) -> Any:
        """The location as the API shows it."""
        return done(self.get(f"/locations/{name}"))

    def everything(self) -> dict[str, Any]:
        """All that is stored and listed, to tell that a refused request left no trace."""
        paths = ("/locations", "/jobs", "/anomalies", "/keys", "/webhooks", "/audit")
        found = {path: done(self.get(f"{path}?limit=1000")) for path in paths}
        # A key is used by asking, too.
        found["/keys"]["items"] = [{**key, "last_used_at": None} for key in found["/keys"]["items"]]
        return found


@contextmanager
def open_house(folder: Path, database_url: str | None = None, **settings: Any) -> Iterator[Api]:
    """The site with a quiet updater and no viewer."""
    chosen: dict[str, Any] = {"viewer": False, "updater": False, "log_level": "warning", "max_body_bytes": 2**20}
    chosen |= {"wrong_keys_per_minute": 0, **settings}
    clock = Clock()
    configured = Settings(data=folder, database_url=database_url, **chosen)
    prepare_database(configured.url)
    with (
        open_context(configured, clock) as ctx,
        all_in_one(ctx, pages) as site,
        start_blocking_portal() as portal,
    ):
        yield Api(ctx, Http(portal, site), clock)


def check_described(answer: httpx.Response) -> None:
    """The document says that this operation can answer with this kind of problem."""
    kind = answer.json()["type"].rpartition(":")[2]
    path = answer.request.url.raw_path.decode().partition("?")[0]
    for (method, pattern), kinds in described_problems().items():
        if method == answer.request.method and re.fullmatch(pattern, path):
            assert kind in kinds or kind == "blank", (method, path, answer.text)
            return


@cache
def described_problems() -> dict[tuple[str, str], set[str]]:
    """The kinds of problems of each operation of the API, by method and pattern of its path."""
    with TemporaryDirectory() as folder:
        settings = Settings(data=Path(folder), updater=False)
        prepare_database(settings.url)
        with open_context(settings) as ctx:
            paths = create_app(ctx).openapi()["paths"]
    return {
        (method.upper(), re.sub(r"\{\w+\}", "[^/]+", path)): {
            kind
            for status, response in operation["responses"].items()
            if status[0] in "45"
            for kind in response.get("content", {}).get(PROBLEM, {}).get("examples", {})
        }
        for path, item in sorted(paths.items())
        for method, operation in item.items()
        if path.startswith(BASE)
    }


def done(answer: httpx.Response, status: int = 200) -> Any:
    """The JSON of an answer that has this status."""
    assert answer.status_code == status, f"{answer.status_code}: {answer.text[:2000]}"
    return answer.json()


def problem(answer: httpx.Response, status: int, kind: str | None = None) -> Any:
    """The problem document of an answer that has this status and ends its `type` in this kind."""
    assert answer.status_code == status, f"{answer.status_code}: {answer.text[:2000]}"
    assert answer.headers["content-type"] == PROBLEM
    found = answer.json()
    assert {"type", "title", "status", "detail", "instance"} <= found.keys()
    assert found["status"] == status
    assert answer.request.url.raw_path.decode().split("?")[0].startswith(BASE)
    assert len(found["detail"]) > 10
    for leak in ("Traceback", 'File "', ".py", "sqlite", "psycopg", "pydantic"):
        assert leak not in answer.text
    if kind is not None:
        assert found["type"].endswith(f":{kind}"), found["type"]
    return found


def arrow(columns: Mapping[str, Any], **options: Any) -> bytes:
    """An Arrow IPC stream of columns: arrays, lists or Arrow arrays."""
    return arrow_table(pa.table({name: _column(values) for name, values in columns.items()}), **options)


def arrow_table(table: Any, **options: Any) -> bytes:
    """An Arrow IPC stream of a table."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=pa.ipc.IpcWriteOptions(**options)) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


def npy(columns: Mapping[str, Any]) -> bytes:
    """An npy file of a structured array with a field a column."""
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    length = len(next(iter(arrays.values())))
    rows = np.empty(length, [(name, values.dtype, values.shape[1:]) for name, values in arrays.items()])
    for name, values in arrays.items():
        rows[name] = values
    return npy_file(rows)


def npy_file(array: Any) -> bytes:
    """An npy file of an array."""
    sink = io.BytesIO()
    np.save(sink, array)
    return sink.getvalue()


def _column(values: Any) -> Any:
    return values if isinstance(values, pa.Array | pa.ChunkedArray) else pa.array(values)


def fortnight() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Times and states of a door that stands open from 9 to 17 on each of the fourteen days before NOW."""
    time = NOW - 14 * DAY + HOUR * np.arange(14 * 24)
    hour = (time // HOUR) % 24
    return time, ((hour >= 9) & (hour < 17)).astype(np.uint8)
