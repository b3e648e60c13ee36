"""Bodies that no route can make anything of."""

import json
from collections.abc import Iterator
from typing import Any

from tests.api.house import NOW
from tests.api.refusals import DOOR, LAB, Case, T, Untouched, form, raw, table

# Every route that takes a JSON form, with one that it would take.
FORMS: dict[str, tuple[str, Any]] = {
    "/locations": ("POST", {"name": "new", "interval_s": 60}),
    DOOR: ("PATCH", {"confidence": 0.8}),
    f"{DOOR}/observations": ("POST", {"time": [T], "state": [1]}),
    f"{LAB}/observations": ("POST", {"observations": [{"time": T, "occupied": [1]}]}),
    f"{DOOR}/update": ("POST", {"order": 2}),
    f"{DOOR}/predict": ("POST", {"time": [T]}),
    f"{DOOR}/evaluate": ("POST", {"orders": [1]}),
    f"{DOOR}/anomalies/detect": ("POST", {"start": 0, "stop": NOW}),
    "/anomalies/1/acknowledge": ("POST", {"note": "seen"}),
    "/keys": ("POST", {"name": "r", "role": "robot"}),
}
OPTIONAL = {f"{DOOR}/update", "/anomalies/1/acknowledge"}


def unreadable() -> Iterator[Case]:
    """Bodies that no route can make anything of."""
    for path, (method, good) in FORMS.items():
        plain = json.dumps(good).encode()
        yield form(path, {**good, "unknown_field": 1}, "unknown_field", "not known", method=method)
        yield form(path, [good], "body", "object", method=method)
        yield form(path, 3, "body", "object", method=method)
        yield form(path, "text", "body", "object", method=method)
        yield raw(path, b"{", 400, None, "JSON", method=method)
        yield raw(path, plain + b"}", 400, None, "JSON", method=method)
        yield raw(path, b'{"\xff": 1}', 400, None, "JSON", method=method)
        yield raw(path, b"[" * 100_000, 400, None, "JSON", method=method)
        yield raw(path, b'{"a":' * 10_000 + b"1" + b"}" * 10_000, 400, None, "JSON", method=method)
        yield raw(path, plain, 415, None, "application/json", "text/plain", method=method)
        yield raw(path, plain, 415, None, "application/json", None, method=method)
        yield raw(path, plain, 415, None, "application/json", "application/octet-stream", method=method)
        yield raw(path, plain, 415, None, "application/json", "application/x-www-form-urlencoded", method=method)
        yield raw(path, plain, 400, None, "unpacked", method=method, **{"Content-Encoding": "gzip"})
        yield raw(path, plain, 400, None, "unpacked", method=method, **{"Content-Encoding": "zstd"})
        yield raw(path, plain, 415, None, "gzip, zstd", method=method, **{"Content-Encoding": "br"})
        yield raw(path, plain, 415, None, "gzip, zstd", method=method, **{"Content-Encoding": "gzip, gzip"})
        yield raw(path, b'{"x":"' + b"y" * 2**20 + b'"}', 413, None, "bytes", method=method)
        if path not in OPTIONAL:
            status, names, says = (400, None, "JSON") if path.endswith("observations") else (422, "body", "missing")
            yield raw(path, b"", status, names, says, method=method)


@table(*unreadable())
def test_bodies_that_no_route_reads(site: Untouched, case: Case) -> None:
    site.refuse(case)


def test_a_million_wrong_things_are_told_in_few_words(site: Untouched) -> None:
    """The memory of their errors would be a thousand times that of the body."""
    many: list[dict[str, int]] = [{}] * 100_000
    lists = [
        (f"{DOOR}/predict", {"time": many}, "time[0]"),
        (f"{DOOR}/predict", {"time": [T], "cell": many}, "cell[0]"),
        (f"{DOOR}/evaluate", {"orders": [1], "time": many}, "time[0]"),
        (f"{DOOR}/evaluate", {"orders": [1], "time": [T], "state": many}, "state[0]"),
        (f"{DOOR}/evaluate", {"orders": many}, "orders[0]"),
        (f"{DOOR}/evaluate", {"orders": [1], "estimators": many}, "estimators[0]"),
        (f"{DOOR}/observations", {"time": many, "state": []}, "time[0]"),
        (f"{LAB}/observations", {"observations": many}, "observations[0].time"),
    ]
    for path, document, first in lists:
        site.refuse(form(path, document, first))
    unknown = {str(number): 0 for number in range(9_000)}
    for path, (method, good) in FORMS.items():
        found = site.refuse(form(path, {**good, **unknown}, None, "known are", method=method))
        assert len(found["errors"]) <= 100


def test_a_form_without_long_columns_is_small(site: Untouched) -> None:
    """It could not be read in pieces, and others would wait for it."""
    shape = {"name": "x", "interval_s": 60, "kind": "grid2d", "grid": {"shape": [{}] * 100_000}}
    site.refuse(raw("/locations", json.dumps(shape).encode(), 413, None, "bytes"))
