"""Requests that must be refused, and the site that they must leave as it was."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.api.house import ARROW, HOUR, JSON, NOW, NPY, Api, arrow, fortnight, npy, problem

DOOR, LAB = "/locations/door", "/locations/lab"
NAN, INFINITY = float("nan"), float("inf")
T = NOW - HOUR
"""A time that may be observed."""


@dataclass(frozen=True)
class Case:
    """A request and what must come of it: the status and the field that `errors` names, words of the problem."""

    method: str
    path: str
    status: int
    names: str | None = None
    says: str = ""
    how: dict[str, Any] = field(default_factory=dict)


def form(path: str, value: Any, names: str | None, says: str = "", status: int = 422, method: str = "POST") -> Case:
    """A JSON form, NaN and infinity written as many writers do."""
    return raw(path, json.dumps(value).encode(), status, names, says, method=method)


def raw(
    path: str,
    content: bytes,
    status: int,
    names: str | None = None,
    says: str = "",
    media_type: str | None = JSON,
    method: str = "POST",
    **headers: str,
) -> Case:
    """A body as it is."""
    sent = {**({"Content-Type": media_type} if media_type else {}), **headers}
    return Case(method, path, status, names, says, {"content": content, "headers": sent})


def ask(path: str, names: str | None, says: str = "", status: int = 422, method: str = "GET") -> Case:
    """A question in the address."""
    return Case(method, path, status, names, says)


def state(time: Any, states: Any, names: str, says: str = "") -> Case:
    return form(f"{DOOR}/observations", {"time": time, "state": states}, names, says)


def look(observation: Any, names: str, says: str = "") -> Case:
    return form(f"{LAB}/observations", {"observations": [observation]}, names, says)


def columns(path: str, table: Any, status: int, names: str | None, says: str = "") -> Case:
    content = table if isinstance(table, bytes) else arrow(table)
    return raw(f"{path}/observations", content, status, names, says, ARROW)


def structured(path: str, table: Any, status: int, names: str | None, says: str = "") -> Case:
    content = table if isinstance(table, bytes) else npy(table)
    return raw(f"{path}/observations", content, status, names, says, NPY)


def table(*cases: Case) -> pytest.MarkDecorator:
    """Parametrises a test with cases, numbered so that each can be run alone."""
    return pytest.mark.parametrize("case", [pytest.param(case, id=_name(i, case)) for i, case in enumerate(cases)])


def _name(number: int, case: Case) -> str:
    sent = str(case.how.get("content", ""))[2:60]
    return f"{number}-{case.method}-{case.path[:60]}-{case.status}-{case.names}-{sent}"


class Untouched:
    """A site whose stored things a refused request must leave as they were."""

    def __init__(self, api: Api) -> None:
        self.api = api
        file = Path(api.ctx.settings.data, "tidemap.db")
        self._sqlite = sqlite3.connect(file) if file.exists() else None
        self._commits: Any = self._count_commits()
        self._before = self._stored()

    def _count_commits(self) -> Any:
        """Changes with every commit of anybody; None on a database that does not count them."""
        return None if self._sqlite is None else self._sqlite.execute("PRAGMA data_version").fetchone()

    def _stored(self) -> dict[str, Any]:
        """All that is stored, row by row, or all that is listed, which takes much longer to ask for."""
        return self.api.everything() if self._sqlite is None else _rows(self._sqlite)

    def check(self) -> None:
        """Nothing was committed, or at least nothing but notes of the request: that it was refused, and its key."""
        commits = self._count_commits()
        if commits is None or commits != self._commits:
            assert self._stored() == self._before
        self._commits = commits

    def accept(self) -> None:
        """What was stored since is to stay."""
        self._commits = self._count_commits()
        self._before = self._stored()

    def close(self) -> None:
        """Let go of the database."""
        if self._sqlite is not None:
            self._sqlite.close()

    def refuse(self, case: Case) -> Any:
        found = problem(self.api.request(case.method, case.path, **case.how), case.status)
        words = " ".join([found["detail"], *(each["message"] for each in found.get("errors", []))])
        assert case.says in words, words
        if case.names is not None:
            assert case.names in [each["field"] for each in found["errors"]], found["errors"]
            assert all(len(each["message"]) > 5 for each in found["errors"])
        self.check()
        return found


def _rows(database: sqlite3.Connection) -> dict[str, Any]:
    """The rows of each table of a database, but notes of requests: of what was refused, and when a key was used."""
    tables = [name for (name,) in database.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
    return {
        name: database.execute(f"SELECT {_shown(database, name)} FROM {name}").fetchall()
        for name in tables
        if name != "refusal"
    }


def _shown(database: sqlite3.Connection, table: str) -> str:
    """The columns of a table that a refused request has to leave as they were."""
    columns = [name for _, name, *_ in database.execute(f"PRAGMA table_info({table})")]
    return ", ".join(f'"{name}"' for name in columns if name != "last_used_at")


@contextmanager
def furnished(api: Api) -> Iterator[Untouched]:
    """A door and a lab with models, one event and two jobs."""
    time, state_ = fortnight()
    api.location(name="door", estimator="fft", order=3, confidence=0.75)
    api.observe("door", time, state_)
    api.update("door")
    assert api.observe("door", [NOW + 1], [1])["anomalies"]
    api.lab(name="lab", estimator="static")
    api.look("lab", (T, [0], [1, 2]))
    api.update("lab")
    untouched = Untouched(api)
    yield untouched
    untouched.close()
