"""Locations that cannot be made or changed as asked."""

from typing import Any

import pytest

from tests.api.house import GRID, NOW
from tests.api.refusals import DOOR, INFINITY, NAN, Case, T, Untouched, ask, form, raw, table


def location(change: dict[str, Any], names: str | None, says: str = "") -> Case:
    return form("/locations", {"name": "new", "interval_s": 60} | change, names, says)


def grid(change: dict[str, Any], names: str | None, says: str = "", kind: str = "grid3d") -> Case:
    return form("/locations", {"name": "new", "interval_s": 60, "kind": kind, "grid": {**GRID, **change}}, names, says)


LOCATIONS = [
    *(
        location({"name": name}, "name")
        for name in (
            "",
            " ",
            "a b",
            "-a",
            ".",
            "..",
            "a/b",
            "../etc",
            "ä",
            "a\0",
            "a\n",
            "x" * 129,
            "a?b",
            "a%2Fb",
            7,
            None,
        )
    ),
    form("/locations", {"interval_s": 60}, "name", "missing"),
    form("/locations", {"name": "new"}, "interval_s", "missing"),
    *(location({"interval_s": value}, "interval_s") for value in (0, -1, NAN, INFINITY, 1e-9, 1e9, "soon", None, [60])),
    *(
        location({"time_zone": value}, "time_zone")
        for value in (
            "__init__/UTC",
            ".",
            "a\0",
            "",
            "Mars/Olympus",
            "../../etc/passwd",
            "/etc/localtime",
            "UTC\0",
            "x" * 5000,
            "Europe",
            3,
            None,
        )
    ),
    location({"epoch": "2026"}, "epoch", "a number in quotes"),
    location({"epoch": "2026-03-01"}, "epoch", "a date alone"),
    *(location({"epoch": value}, "epoch") for value in (NAN, 1e300, -1e12, "2026-03-01T00:00:00", "then", True, None)),
    *(location({"confidence": value}, "confidence") for value in (2, 1, 0.49, 0, -1, NAN, "high", None)),
    *(location({"order": value}, "order") for value in (65, 0, -1, 1.5, "all")),
    *(location({"estimator": value}, "estimator") for value in ("magic", "", 1)),
    location({"kind": "grid4d"}, "kind"),
    location({"missing": "guess"}, "missing"),
    location({"missing": "hold"}, None, "hold_s"),
    *(location({"hold_s": value}, "hold_s") for value in (0, -1, NAN, 1e300)),
    *(
        location({"calendar": value}, "calendar")
        for value in ("", "gb", "GBR", "GB-", "XX", "GB-XX", "England", 3, ["GB"])
    ),
    location({"calendar": "ZZ"}, "calendar", "ISO 3166"),
    location({"pose": {"position": [0, 1]}}, "pose.position[2]"),
    location({"pose": {"position": [0, 1, NAN]}}, "pose.position[2]"),
    location({"pose": {"frame": "", "position": [0, 1, 2]}}, "pose.frame"),
    location({"pose": {"frame": "map"}}, "pose.position"),
    location({"pose": [0, 1, 2]}, "pose"),
    *(location({"retention": value}, "retention") for value in (0, -5, INFINITY, 1e300)),
    *(location({"min_cells": value}, "min_cells") for value in (0, -1, 1.5, 2**31, 10**30)),
    location({"kind": "grid3d"}, None, "grid"),
    location({"kind": "grid2d"}, None, "grid"),
    location({"grid": GRID}, None, "grid"),
    grid({"shape": [4, 3]}, None, "grid.shape"),
    grid({}, None, "grid.shape", kind="grid2d"),
    grid({"shape": [0, 3, 2]}, "grid.shape[0]"),
    grid({"shape": [4, 3, -2]}, "grid.shape[2]"),
    grid({"shape": [4]}, "grid.shape"),
    grid({"shape": [1, 2, 3, 4]}, "grid.shape"),
    grid({"shape": []}, "grid.shape"),
    grid({"shape": [4, 3, 2.5]}, "grid.shape[2]"),
    grid({"shape": [65536, 65536, 65536]}, "grid.shape", "cells"),
    grid({"shape": [70000, 2, 2]}, "grid.shape[0]"),
    grid({"resolution_m": 0}, "grid.resolution_m"),
    grid({"resolution_m": NAN}, "grid.resolution_m"),
    grid({"resolution_m": -0.1}, "grid.resolution_m"),
    grid({"origin": [0, 0]}, "grid.origin[2]"),
    grid({"origin": [0, 0, INFINITY]}, "grid.origin[2]"),
    grid({"frame": ""}, "grid.frame"),
    grid({"frame": "a\0"}, "grid.frame", "NUL"),
    grid({"colour": 1}, "grid.colour", "not known"),
    raw("/locations", b'{"name": "\\ud800", "interval_s": 60}', 422, "name"),
    raw("/locations", b'{"name": "new", "interval_s": 1' + b"0" * 400 + b"}", 422, "interval_s"),
    raw("/locations", b'{"name": "new", "interval_s": 1' + b"0" * 5000 + b"}", 400, None, "JSON"),
    Case("POST", "/locations", 409, None, "door", {"json": {"name": "door", "interval_s": 60}}),
    *(ask(f"/locations?limit={value}", "limit") for value in ("0", "100000", "-1", "x", "1.5", "")),
    ask("/locations?after=%00", "after", "NUL"),
    *(
        form(DOOR, {name: None}, name, "null", method="PATCH")
        for name in ("name", "time_zone", "estimator", "order", "confidence", "missing", "min_cells")
    ),
    form(DOOR, {"name": "a/b"}, "name", method="PATCH"),
    form(DOOR, {"confidence": 2}, "confidence", method="PATCH"),
    form(DOOR, {"min_cells": 2**31}, "min_cells", method="PATCH"),
    form(DOOR, {"time_zone": "Nowhere"}, "time_zone", "IANA", method="PATCH"),
    form(DOOR, {"interval_s": 60}, "interval_s", "cannot be changed later", method="PATCH"),
    form(DOOR, {"missing": "hold"}, "hold_s", method="PATCH"),
]


@table(*LOCATIONS)
def test_forms(site: Untouched, case: Case) -> None:
    site.refuse(case)


def test_all_wrong_fields_are_named_at_once(site: Untouched) -> None:
    wrong = {"name": "a b", "interval_s": -1, "confidence": 2, "colour": 1, "time_zone": "Nowhere"}
    found = site.refuse(form("/locations", wrong, "name"))
    assert {each["field"] for each in found["errors"]} == set(wrong)


# Every route under a location, for names that nothing has.
UNDER: list[tuple[str, str, Any]] = [
    ("GET", "", None),
    ("PATCH", "", {"confidence": 0.8}),
    ("DELETE", "", None),
    ("POST", "/observations", {"time": [T], "state": [1]}),
    ("POST", "/update", {}),
    ("GET", "/state", None),
    ("POST", "/predict", {"time": [T]}),
    ("GET", "/series", None),
    ("GET", "/model", None),
    ("POST", "/evaluate", {"orders": [1]}),
    ("GET", "/anomalies", None),
    ("POST", "/anomalies/detect", {"start": 0, "stop": NOW}),
]
NOWHERE = [
    "nowhere",
    "Door",
    "door%20",
    "a%2Fb",
    "..%2F..%2Fetc",
    "%C3%A4",
    "%F0%9F%9A%AA",
    "%ff",
    "a%00b",
    "x" * 4000,
    "'--",
    "%25",
]


@pytest.mark.parametrize("name", NOWHERE, ids=lambda name: name[:20])
@pytest.mark.parametrize(("method", "route", "good"), UNDER, ids=[f"{method} {route}" for method, route, _ in UNDER])
def test_locations_that_are_not_there(site: Untouched, name: str, method: str, route: str, good: Any) -> None:
    how = {} if good is None else {"json": good}
    site.refuse(Case(method, f"/locations/{name}{route}", 404, how=how))
