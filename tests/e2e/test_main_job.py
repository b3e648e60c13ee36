"""The main job on the paper's office week, over HTTP against a fresh server as people run it."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import numpy as np
import orjson
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from tests.support.memory import peak_memory_mb
from tests.support.office import Office, Signal
from tests.support.server import ServerProcess, StartServer, fresh

WEEK_S = 7 * 86400
ACCEPTED_S = 60
MEMORY_MB = 600
ARROW = "application/vnd.apache.arrow.stream"


def as_json(part: Signal) -> tuple[bytes, str]:
    columns = {"time": part.time_s, "state": part.state}
    return orjson.dumps(columns, option=orjson.OPT_SERIALIZE_NUMPY), "application/json"


def as_arrow(part: Signal) -> tuple[bytes, str]:
    table = pa.table({"time": part.time_s.astype(np.float64), "state": part.state})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue()), ARROW


Encode = Callable[[Signal], tuple[bytes, str]]
# How it is sent, and in how many posts.
WAYS: dict[str, tuple[Encode, int]] = {"json": (as_json, 1), "json-days": (as_json, 7), "arrow": (as_arrow, 1)}


@dataclass(frozen=True)
class Door:
    """The office door on a server that was told its week, and how long that took."""

    http: httpx.Client
    path: str
    posted_s: float
    accepted: int

    def get(self, question: str) -> Any:
        answer = self.http.get(f"{self.path}/{question}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    def post(self, question: str, form: object) -> Any:
        answer = self.http.post(f"{self.path}/{question}", json=form)
        assert answer.status_code == 200, answer.text
        return answer.json()


@pytest.fixture(scope="module")
def shared_server(module_server: StartServer) -> ServerProcess:
    """Not a fork: all of its memory is measured."""
    return module_server(launch=fresh)


@pytest.fixture(scope="module")
def http(shared_server: ServerProcess) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{shared_server.url}/api/v1", timeout=120, trust_env=False) as client:
        yield client


@pytest.fixture(scope="module", params=WAYS)
def door(request: pytest.FixtureRequest, http: httpx.Client, office: Office) -> Door:
    """The week posted and fitted at order 15."""
    encode, posts = WAYS[request.param]
    name = f"office-{request.param}"
    form = {"name": name, "kind": "state", "interval_s": 1, "estimator": "fft"}
    assert http.post("/locations", json=form).status_code == 201
    began = time.monotonic()
    accepted = 0
    for times, states in zip(*(np.array_split(c, posts) for c in (office.week.time_s, office.week.state)), strict=True):
        body, media_type = encode(Signal(times, states))
        answer = http.post(f"/locations/{name}/observations", content=body, headers={"Content-Type": media_type})
        assert answer.status_code == 201, answer.text
        accepted += answer.json()["accepted"]
    posted_s = time.monotonic() - began
    job = http.post(f"/locations/{name}/update?wait=60", json={"order": 15})
    assert (job.status_code, job.json()["state"]) == (200, "done"), job.text
    return Door(http, f"/locations/{name}", posted_s, accepted)


def test_the_week_is_accepted_in_time(door: Door) -> None:
    assert door.accepted == WEEK_S
    assert door.posted_s < ACCEPTED_S
    known = door.http.get(door.path).json()
    assert known["observations"] == WEEK_S
    assert (known["first_time"], known["last_time"]) == ("1970-01-01T00:00:00Z", "1970-01-07T23:59:59Z")


def test_order_15_keeps_95_percent(door: Door) -> None:
    known = door.http.get(door.path).json()
    model = door.get("model")
    assert known["accuracy"] == pytest.approx(0.953, abs=0.002)
    assert model["accuracy"] == pytest.approx(known["accuracy"])
    assert (model["order"], model["samples"], model["interval_s"]) == (15, WEEK_S, 1)


def test_prediction_peaks_at_order_2(door: Door, office: Office) -> None:
    orders = [0, 1, 2, 3, 5, 10, 15, 20]
    for day, accuracy in ((office.day_1, 0.968), (office.day_2, 0.953)):
        form = {"orders": orders, "estimators": ["fft"], "time": day.time_s.tolist(), "state": day.state.tolist()}
        rows = {row["order"]: row for row in door.post("evaluate", form)["results"]}
        assert list(rows) == orders
        assert 1 - rows[2]["error"] == pytest.approx(accuracy, abs=0.003)
        assert all(row["n"] == day.state.size for row in rows.values())
        assert rows[2]["error"] < rows[1]["error"]
        assert rows[2]["error"] < rows[3]["error"]


def test_the_history_comes_back_exactly(door: Door, office: Office) -> None:
    series = door.get("series")
    np.testing.assert_array_equal(series["time"], office.week.time_s)
    np.testing.assert_array_equal(series["observed"], office.week.state)


@pytest.mark.parametrize("order", [0, 2, 15, 40])
def test_components_and_outliers_rebuild_it_exactly(door: Door, office: Office, order: int) -> None:
    model = door.get(f"model?order={order}")
    assert len(model["components"]) == order
    np.testing.assert_array_equal(rebuilt(model, office.week.time_s), office.week.state)
    wrong = sum(stop - start for start, stop in model["outliers"])
    assert model["accuracy"] == pytest.approx(1 - wrong / WEEK_S)


def rebuilt(model: dict[str, Any], time_s: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Eq. 1 by the formula that the answer documents: (p(t) > 0.5) xor (t in O)."""
    assert model["start"] == "1970-01-01T00:00:00Z"
    p = np.full(time_s.size, model["mean"])
    for wave in model["components"]:
        p += wave["amplitude"] * np.cos(2 * np.pi * wave["frequency_hz"] * time_s + wave["phase"])
    outlier = np.zeros(time_s.size, np.bool_)
    for start, stop in model["outliers"]:
        outlier[int(start) : int(stop)] = True
    return np.asarray((p > 0.5) ^ outlier)


def test_it_finds_the_44_surprises(door: Door) -> None:
    form = {"start": 0, "stop": WEEK_S, "confidence": 0.95, "rule": "surprise", "order": 15}
    events = door.post("anomalies/detect", form)["items"]
    assert len(events) == 44
    assert all(event["surprise"] > 0.95 for event in events)
    starts = [event["start"] for event in events]
    assert starts == sorted(starts)
    by_night = [event for event in events if event["observed"] == 1 and not "07" <= event["start"][11:13] < "18"]
    assert len(by_night) == 7


def test_the_model_shows_the_day(door: Door) -> None:
    components = door.get("model")["components"]
    amplitudes = [each["amplitude"] for each in components]
    assert amplitudes == sorted(amplitudes, reverse=True)
    assert any(each["period_s"] == pytest.approx(86400) for each in components)
    assert components[0]["period_s"] == pytest.approx(86400)


def test_the_figures_of_compression_are_honest(door: Door, office: Office) -> None:
    model = door.get("model")
    figures = model["compression"]
    switches = int(np.count_nonzero(np.diff(office.week.state.astype(np.int8))))
    assert (figures["samples"], figures["raw_bytes"]) == (WEEK_S, WEEK_S // 8)
    # Every run costs a byte at least and three at most; a component a frequency, an amplitude and a phase.
    assert switches < figures["history_bytes"] <= 3 * (switches + 1)
    assert 15 * 8 < figures["spectrum_bytes"] <= 15 * 24 + 64
    assert 2 * len(model["outliers"]) <= figures["outlier_bytes"] <= 6 * len(model["outliers"])
    assert figures["lossy_ratio"] == pytest.approx(figures["raw_bytes"] / figures["spectrum_bytes"])
    assert figures["lossless_ratio"] == pytest.approx(figures["raw_bytes"] / figures["history_bytes"])
    whole = figures["spectrum_bytes"] + figures["outlier_bytes"]
    assert figures["paper_lossless_ratio"] == pytest.approx(figures["raw_bytes"] / whole)


def test_asking_stored_nothing(door: Door) -> None:
    assert door.http.get(door.path).json()["revision"] == door.get("model")["revision"]
    assert door.get("model")["order"] == 15


def test_the_whole_server_stays_small(door: Door, shared_server: ServerProcess) -> None:
    assert peak_memory_mb(shared_server.process.pid) < MEMORY_MB
