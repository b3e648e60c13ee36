"""Questions that are refused, on every route that takes one."""

import re
from pathlib import Path

import pytest

from tests.api.house import BASE, DAY, NOW, PROBLEM, Api, done, open_house, problem
from tests.api.refusals import DOOR, INFINITY, LAB, NAN, Case, T, Untouched, ask, form, furnished, raw, table
from tests.support.databases import Databases

QUESTIONS = [
    *(
        ask(f"{DOOR}/state?time={value}", "time")
        for value in (
            "2026-03-01T00:00:00",
            "now",
            "nan",
            "inf",
            "-inf",
            "1e300",
            "1e15",
            "",
            "%00",
            "0001-01-01T00:00:00Z",
        )
    ),
    *(
        ask(f"{DOOR}/state?time={value}", "time", "reads as a date")
        for value in ("2026", "20260301", "0930", "00", "-07")
    ),
    ask(f"{DOOR}/state?time=2026-03-01", "time", "a date alone"),
    ask(f"{DOOR}/series?start=2026", "start", "like 2026.0"),
    ask(f"{DOOR}/series?stop=2026-03-01Z", "stop", "time of day"),
    ask("/anomalies?start=2026", "start", "reads as a date"),
    *(ask(f"{DOOR}/state?confidence={value}", "confidence") for value in ("2", "1", "0.4", "nan", "inf", "x", "")),
    *(ask(f"{DOOR}/state?order={value}", "order") for value in ("65", "-1", "1.5", "x", "9" * 400, "9" * 5000)),
    *(ask(f"{DOOR}/state?estimator={value}", "estimator") for value in ("magic", "auto", "")),
    ask(f"{DOOR}/state?observed=perhaps", "observed"),
    ask(f"{DOOR}/state?bbox=0,0,0,1,1,1", "bbox", "leave bbox out"),
    *(
        ask(f"{LAB}/state?bbox={value}", "bbox", "six numbers")
        for value in (
            "",
            "1",
            "0,0,0,1,1",
            "0,0,0,1,1,1,1",
            "a,b,c,d,e,f",
            "0,0,0,1,1,nan",
            "0,0,0,1,1,inf",
            "1e300,0,0,1,1,1",
        )
    ),
    ask(f"{LAB}/export", "format"),
    *(ask(f"{LAB}/export?format={value}", "format") for value in ("", "bag", "NAV2", "nav2,ply")),
    *(ask(f"{DOOR}/export?format={value}", "format", "npz") for value in ("nav2", "octomap", "ply", "pcd")),
    *(ask(f"{LAB}/export?format=nav2&time={value}", "time") for value in ("now", "nan", "2026-03-01T00:00:00")),
    *(ask(f"{LAB}/export?format=nav2&confidence={value}", "confidence") for value in ("2", "1", "0.4", "nan")),
    *(ask(f"{LAB}/export?format=nav2&{name}=x", name) for name in ("source", "mode", "given", "z_min", "z_max")),
    *(ask(f"{LAB}/export?format=nav2&z_min={value}", "z_min") for value in ("nan", "inf", "1e300", "")),
    ask(f"{LAB}/export?format=nav2&z_min=2&z_max=1", "z_max", "swap"),
    ask(f"{LAB}/export?format=ply&z_min=5", "z_min", "0.25 to 0.75 m"),
    ask(f"{LAB}/export?format=ply&z_max=0.2", "z_max", "0.25 to 0.75 m"),
    ask(f"{DOOR}/export?format=npz&z_min=0", "z_min", "one layer"),
    ask(f"{LAB}/export?format=nav2&bbox=1", "bbox"),
    *(ask(f"{DOOR}/series?cell={value}", "cell") for value in ("x", "1.5", "", "1e3")),
    *(ask(f"{DOOR}/series?step={value}", "step") for value in ("0", "-1", "nan", "x", "1e-320", "1e-300", "1e-3")),
    ask(f"{DOOR}/series?start=10&stop=9", "stop", "swap"),
    ask(f"{DOOR}/density?start=10&stop=9", "stop", "swap"),
    *(ask(f"{DOOR}/density?bins={value}", "bins") for value in ("0", "1001", "x")),
    ask(f"{DOOR}/series?start=-6e10&stop=6e10", "step", "longer step"),
    ask(f"{DOOR}/series?start=x", "start", "ISO 8601"),
    ask(f"{DOOR}/series?stop=2026-03-01T00:00:00", "stop", "zone"),
    *(ask(f"{DOOR}/information?step={value}", "step") for value in ("0", "-1", "nan", "x", "1e-3")),
    *(ask(f"{DOOR}/information?best={value}", "best") for value in ("-1", "101", "1.5", "x", "")),
    *(ask(f"{DOOR}/information?{name}={value}", name) for name in ("miss", "false_alarm") for value in ("-0.1", "nan")),
    ask(f"{DOOR}/information?miss=0.5&false_alarm=0.5", "miss", "less than 1"),
    ask(f"{DOOR}/information?start=10&stop=9", "stop", "swap"),
    ask(f"{DOOR}/information?time=10&best=1", "time", "one time, or for a window"),
    ask(f"{DOOR}/information?time=2026", "time", "reads as a date"),
    ask(f"{DOOR}/information?as_of=now", "as_of", "ISO 8601"),
    ask(f"{DOOR}/information?given=nothing", "given"),
    ask(f"{DOOR}/information?bbox=0,0,0,1,1,1", "bbox", "leave bbox out"),
    ask(f"{LAB}/information?bbox=0,0,0", "bbox", "six numbers"),
    ask(f"{DOOR}/information?cell=1", "cell", "known are"),
    *(ask(f"{DOOR}/model?order={value}", "order") for value in ("65", "-1", "x")),
    ask(f"{DOOR}/model?cell=x", "cell"),
    *(
        ask(f"{DOOR}/{question}?cell={cell}", None, "0 to 0", 404)
        for question in ("series", "model")
        for cell in (1, -1, 10**40)
    ),
    # predict
    *(
        form(f"{DOOR}/predict", {"time": [T, value]}, "time[1]")
        for value in (NAN, INFINITY, "2026-03-01T00:00:00", "now", None, True, 1e300, [T], 10**400)
    ),
    form(f"{DOOR}/predict", {"time": [T, "2026"]}, "time[1]", "a number in quotes"),
    form(f"{DOOR}/predict", {"time": []}, "time"),
    form(f"{DOOR}/predict", {"time": T}, "time"),
    form(f"{DOOR}/predict", {}, "time", "missing"),
    form(f"{DOOR}/predict", {"time": [T], "cell": ["x"]}, "cell[0]"),
    form(f"{DOOR}/predict", {"time": [T], "cell": [0.5]}, "cell[0]"),
    form(f"{DOOR}/predict", {"time": [T], "cell": [False]}, "cell[0]"),
    form(f"{DOOR}/predict", {"time": [T], "cell": ["0"]}, "cell[0]"),
    form(f"{DOOR}/predict", {"time": [T], "cell": [1]}, None, "0 to 0", 404),
    form(f"{DOOR}/predict", {"time": [T], "cell": [-1]}, None, "0 to 0", 404),
    form(f"{LAB}/predict", {"time": [T] * 60_000}, "time", "fewer times or cells"),
    form(f"{LAB}/predict", {"time": [T], "cell": [[0, 0]]}, "cell", "3 whole numbers"),
    form(f"{LAB}/predict", {"time": [T], "cell": [[0, 0, 0, 0]]}, "cell[0]"),
    form(f"{LAB}/predict", {"time": [T], "cell": [[0, 0, 0.5]]}, "cell[0][2]"),
    form(f"{LAB}/predict", {"time": [T], "cell": [[]]}, "cell[0]"),
    form(f"{LAB}/predict", {"time": [T], "cell": [{}] * 30_000}, "cell[0]"),
    *(form(f"{DOOR}/predict", {"time": [T], "order": value}, "order") for value in (65, -1, 1.5, "auto")),
    *(form(f"{DOOR}/predict", {"time": [T], "confidence": value}, "confidence") for value in (2, 0.1, NAN)),
    form(f"{DOOR}/predict", {"time": [T], "estimator": "magic"}, "estimator"),
    # evaluate
    form(f"{DOOR}/evaluate", {}, "orders", "missing"),
    form(f"{DOOR}/evaluate", {"orders": []}, "orders"),
    form(f"{DOOR}/evaluate", {"horizons_s": []}, "orders", "missing"),
    form(f"{DOOR}/evaluate", {"horizons_s": [60], "estimators": ["fft"]}, "orders", "missing"),
    *(
        form(f"{DOOR}/evaluate", {"horizons_s": [60, value]}, "horizons_s[1]")
        for value in (0, -1, 1e9, NAN, "60", None)
    ),
    form(f"{DOOR}/evaluate", {"horizons_s": list(range(1, 18))}, "horizons_s"),
    form(f"{DOOR}/evaluate", {"horizons_s": [60], "time": [T], "state": [1]}, "horizons_s", "leave time and state out"),
    form(f"{DOOR}/evaluate", {"horizons_s": [60], "train_stop": T}, "train_stop", "leave train_stop out"),
    form(f"{DOOR}/evaluate", {"horizons_s": [60], "start": 0}, "start", "known before start"),
    form(f"{DOOR}/evaluate", {"horizons_s": [60], "start": NOW + DAY}, "start", "observed between"),
    *(form(f"{DOOR}/evaluate", {"orders": [1, value]}, "orders[1]", "0 to 64") for value in (65, -1, 10**9)),
    form(f"{DOOR}/evaluate", {"orders": list(range(66))}, "orders"),
    *(form(f"{DOOR}/evaluate", {"orders": [value]}, "orders[0]") for value in ("x", "1", True)),
    form(f"{DOOR}/evaluate", {"orders": [1], "estimators": []}, "estimators"),
    form(f"{DOOR}/evaluate", {"orders": [1], "estimators": ["magic"]}, "estimators[0]"),
    form(f"{DOOR}/evaluate", {"orders": [1], "start": NOW, "stop": T}, "stop", "swap"),
    form(f"{DOOR}/evaluate", {"orders": [1], "start": "2026"}, "start", "a number in quotes"),
    form(f"{DOOR}/evaluate", {"orders": [1], "train_stop": "2026-03-01"}, "train_stop", "a date alone"),
    form(f"{DOOR}/evaluate", {"orders": [1], "start": NOW + DAY, "stop": NOW + 2 * DAY}, "stop", "widen"),
    form(f"{DOOR}/evaluate", {"orders": [1], "train_start": NOW, "train_stop": T}, "train_stop", "widen"),
    form(f"{DOOR}/evaluate", {"orders": [1], "time": [T], "state": [1, 0]}, "state", "one length"),
    form(f"{DOOR}/evaluate", {"orders": [1], "time": [T]}, "state", "both"),
    form(f"{DOOR}/evaluate", {"orders": [1], "state": [1]}, "state", "both"),
    form(f"{DOOR}/evaluate", {"orders": [1], "time": [], "state": []}, "start"),
    form(f"{DOOR}/evaluate", {"orders": [1], "time": [NAN], "state": [1]}, "time[0]"),
    *(
        form(f"{DOOR}/evaluate", {"orders": [1], "time": [T], "state": [value]}, "state[0]")
        for value in (2, -1, "1", None, 0.5)
    ),
    form(f"{DOOR}/evaluate", {"orders": [1], "confidence": 1}, "confidence"),
    # detect
    form(f"{DOOR}/anomalies/detect", {"stop": NOW}, "start", "missing"),
    form(f"{DOOR}/anomalies/detect", {"start": NOW, "stop": T}, "stop", "swap"),
    form(f"{DOOR}/anomalies/detect", {"start": 0, "stop": 1e300}, "stop"),
    form(f"{DOOR}/anomalies/detect", {"start": "then", "stop": NOW}, "start"),
    form(f"{DOOR}/anomalies/detect", {"start": "2026", "stop": NOW}, "start", "a number in quotes"),
    form(f"{DOOR}/anomalies/detect", {"start": 0, "stop": NOW, "rule": "gut"}, "rule"),
    form(f"{DOOR}/anomalies/detect", {"start": 0, "stop": NOW, "confidence": 2}, "confidence"),
    form(f"{DOOR}/anomalies/detect", {"start": 0, "stop": NOW, "order": 65}, "order"),
    # update
    form(f"{DOOR}/update", {"start": NOW, "stop": T}, "stop", "swap"),
    form(f"{DOOR}/update", {"start": NAN}, "start"),
    form(f"{DOOR}/update", {"stop": "0930"}, "stop", "a number in quotes"),
    form(f"{DOOR}/update", {"start": 1e300}, "start"),
    form(f"{DOOR}/update", {"estimator": "magic"}, "estimator"),
    *(form(f"{DOOR}/update", {"order": value}, "order") for value in (0, 65, -1, "all", 2.5)),
    *(form(f"{DOOR}/update?wait={value}", {}, "wait") for value in ("-1", "301", "nan", "inf", "x", "")),
    # acknowledge
    # confidence
    ask(f"{DOOR}/confidence?false_alarms_per_week=-1", "false_alarms_per_week"),
    ask(f"{DOOR}/confidence?false_alarms_per_week=nan", "false_alarms_per_week"),
    ask(f"{DOOR}/confidence?false_alarms_per_week=1e9", "false_alarms_per_week"),
    ask(f"{DOOR}/confidence?rule=gut", "rule"),
    ask(f"{DOOR}/confidence?per_week=1", "per_week"),
    form("/anomalies/1/acknowledge", {"note": 3}, "note"),
    form("/anomalies/1/acknowledge", {"note": "x" * 2001}, "note"),
    form("/anomalies/1/acknowledge", {"note": "a\0"}, "note", "NUL"),
    form("/anomalies/x/acknowledge", {}, "anomaly_id"),
    *(form(f"/anomalies/{number}/acknowledge", {}, None, "no anomaly", 404) for number in (0, -1, 999, 2**63, 10**40)),
    # deletion
    *(
        ask(f"{DOOR}/observations?{query}", field, says, method="DELETE")
        for query, field, says in (
            ("start=0", "stop", ""),
            ("stop=0", "start", ""),
            ("start=2026&stop=3000", "start", "reads as a date"),
            ("start=0&stop=2026-03-01", "stop", "a date alone"),
            ("start=60&stop=0", "stop", "swap them"),
            ("start=0&stop=60&source=", "source", ""),
            ("start=0&stop=60&source=" + "x" * 129, "source", ""),
            ("start=0&stop=60&robot=spot", "robot", "known are start, stop, source"),
        )
    ),
    ask("/locations/attic/observations?start=0&stop=60", None, "no location", 404, "DELETE"),
    # jobs and keys
    *(
        ask(f"/jobs/{number}", None, "no job", 404, method)
        for number in (0, -1, 999, 2**63, 10**40)
        for method in ("GET", "DELETE")
    ),
    ask("/jobs/x", "job_id"),
    *(
        ask(f"/jobs?{query}", query.split("=")[0])
        for query in ("limit=0", "limit=100000", "after=x", "after=-1", "after=" + "9" * 40)
    ),
    *(ask(f"/keys/{number}", None, "no key", 404, "DELETE") for number in (0, -1, 999, 2**63, 10**40)),
    ask("/keys/x", "key_id", method="DELETE"),
]
UNKNOWN = [
    ask(f"{DOOR}/state?tme=1", "tme", "known are time, confidence, order, estimator, bbox, observed"),
    ask(f"{DOOR}/state?time=1&Time=2&cell=1", "cell", "known are time"),
    ask(f"{DOOR}/state?=1", "", "known are time"),
    ask(f"{DOOR}?time=1", "time", "none is known here"),
    form(f"{DOOR}/predict?time=1", {"time": [T]}, "time", "none is known here"),
    raw(f"{DOOR}/observations?robot=r", b'{"time": [1], "state": [1]}', 422, "robot", "known are source"),
    raw(f"{DOOR}/observations?Idempotency-Key=k", b"not even JSON", 422, "Idempotency-Key", "known are source"),
    ask("/keys/999?force=true", "force", method="DELETE"),
]
WRONG_METHODS = [
    ("PUT", "/locations"),
    ("DELETE", "/locations"),
    ("POST", DOOR),
    ("GET", f"{DOOR}/observations"),
    ("PUT", f"{DOOR}/observations"),
    ("GET", f"{DOOR}/update"),
    ("POST", f"{DOOR}/state"),
    ("GET", f"{DOOR}/predict"),
    ("PUT", f"{DOOR}/model"),
    ("GET", f"{DOOR}/evaluate"),
    ("GET", "/anomalies/1/acknowledge"),
    ("PATCH", "/jobs/1"),
    ("GET", "/keys/1"),
    ("FOO", "/keys"),
]
POSTGRESQL = [
    ask("/locations/a%00b", None, status=404),
    ask("/locations?after=%00", "after"),
    raw(f"{DOOR}/observations?source=%00", b'{"time": [1], "state": [1]}', 422, "source"),
    form("/keys", {"name": "a\0", "role": "robot"}, "name"),
    form("/anomalies/1/acknowledge", {"note": "a\0"}, "note"),
    *(ask(f"/jobs/{10**40}", None, status=404, method=method) for method in ("GET", "DELETE")),
    ask(f"/keys/{10**40}", None, status=404, method="DELETE"),
    ask(f"/keys/{2**63 - 1}", None, status=404, method="DELETE"),
    form(f"/anomalies/{10**40}/acknowledge", {}, None, status=404),
]


@table(*QUESTIONS)
def test_questions(site: Untouched, case: Case) -> None:
    site.refuse(case)


@table(*UNKNOWN)
def test_unknown_parameters(site: Untouched, case: Case) -> None:
    site.refuse(case)


@pytest.mark.parametrize(("method", "path"), WRONG_METHODS)
def test_methods_that_are_not_allowed(site: Untouched, method: str, path: str) -> None:
    answer = site.api.request(method, path)
    found = problem(answer, 405)
    assert method in found["detail"]
    allowed = set(answer.headers["allow"].split(", "))
    assert method not in allowed
    assert allowed == described(site.api, path), "all of them"


def described(api: Api, path: str) -> set[str]:
    """The methods that the API's document has for an address."""
    document = done(api.get("/openapi.json"))
    return {
        method.upper()
        for template, item in document["paths"].items()
        if re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), f"{BASE}{path}")
        for method in item
    }


@pytest.mark.parametrize("path", ["/static/any/tidemap.css", "/api/docs", "/"])
def test_methods_of_pages(site: Untouched, path: str) -> None:
    answer = site.api.http.request("PUT", path)
    assert (answer.status_code, answer.headers["content-type"]) == (405, PROBLEM)
    assert "GET" in answer.headers["allow"]


def test_what_only_one_kind_of_database_would_take(databases: Databases, tmp_path: Path) -> None:
    with databases.empty() as url, open_house(tmp_path, url) as api, furnished(api) as site:
        for case in POSTGRESQL:
            site.refuse(case)
