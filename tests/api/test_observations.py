"""/locations/{name}/observations: what is accepted, how it is answered, and what a key makes of a repetition."""

import gzip
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import orjson
import pyarrow as pa
import pytest
import zstandard

from tests.api.house import (
    ARROW,
    DAY,
    HOUR,
    JSON,
    NOW,
    NPY,
    Api,
    arrow,
    arrow_table,
    done,
    fortnight,
    npy,
    npy_file,
    open_house,
    problem,
)
from tidemap.ingest.observation import TOO_OLD
from tidemap.settings import YEAR_S

ANSWERED = {"accepted", "dropped", "duplicate", "first_time", "last_time", "anomalies", "anomalies_total", "revision"}
TIMES = [NOW - 3 * HOUR, NOW - 2 * HOUR, NOW - HOUR]


def observed(api: Api, name: str, cell: int = 0) -> list[int | None]:
    """What the location knows of a cell over the three hours before NOW."""
    query = f"cell={cell}&start={NOW - 3 * HOUR}&stop={NOW}"
    return list(done(api.get(f"/locations/{name}/series?{query}"))["observed"])


def test_the_answer_says_what_was_stored(api: Api) -> None:
    name = api.location()
    answer = api.observe(name, TIMES, [0, 1, 1])
    assert set(answer) == ANSWERED
    assert answer == {
        "accepted": 3,
        "dropped": 0,
        "duplicate": False,
        "first_time": "2026-03-01T21:00:00Z",
        "last_time": "2026-03-01T23:00:00Z",
        "anomalies": [],
        "anomalies_total": 0,
        "revision": 0,
    }
    assert observed(api, name) == [0, 1, 1]


@pytest.mark.parametrize(
    "times",
    [
        [1772398800, 1772402400, 1772406000],
        [1772398800.0, 1772402400.25, 1772406000.5],
        ["2026-03-01T21:00:00Z", "2026-03-01T22:00:00+00:00", "2026-03-02T00:00:00+01:00"],
        ["2026-03-01T21:00:00.000001Z", 1772402400, "20260301T230000Z"],
    ],
    ids=["whole", "float", "iso", "mixed"],
)
def test_times_are_unix_seconds_or_iso_8601_with_a_zone(api: Api, times: list[Any]) -> None:
    name = api.location()
    done(api.post(f"/locations/{name}/observations", {"time": times, "state": [0, 1, 1]}), 201)
    assert observed(api, name) == [0, 1, 1]


def _arrow_bodies() -> dict[str, Callable[[], bytes]]:
    state = np.array([0, 1, 1], np.uint8)
    whole = np.array(TIMES, np.int64)

    def stamps(unit: str, zone: str) -> bytes:
        scale = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
        return arrow({"time": pa.array(whole * scale).cast(pa.timestamp(unit, zone)), "state": state})

    def batches() -> bytes:
        table = pa.table({"time": np.array(TIMES), "state": state})
        return arrow_table(pa.concat_tables([table.slice(0, 1), table.slice(1, 0), table.slice(1)]))

    return {
        "float64": lambda: arrow({"time": np.array(TIMES), "state": state}),
        "int64": lambda: arrow({"time": whole, "state": state}),
        "timestamp-s": lambda: stamps("s", "UTC"),
        "timestamp-ms": lambda: stamps("ms", "Europe/London"),
        "timestamp-us": lambda: stamps("us", "+05:30"),
        "timestamp-ns": lambda: stamps("ns", "America/New_York"),
        "bool": lambda: arrow({"time": np.array(TIMES), "state": state.astype(bool)}),
        "int32": lambda: arrow({"time": np.array(TIMES), "state": state.astype(np.int32)}),
        "columns-swapped": lambda: arrow({"state": state, "time": np.array(TIMES)}),
        "several-batches": batches,
    }


@pytest.mark.parametrize("body", _arrow_bodies().values(), ids=_arrow_bodies())
def test_arrow_columns_are_the_same_measurements(api: Api, body: Callable[[], bytes]) -> None:
    name = api.location()
    answer = api.post(f"/locations/{name}/observations", content=body(), headers={"Content-Type": ARROW})
    assert done(answer, 201)["accepted"] == 3
    assert (answer.json()["first_time"], answer.json()["last_time"]) == ("2026-03-01T21:00:00Z", "2026-03-01T23:00:00Z")
    assert observed(api, name) == [0, 1, 1]


def _npy_bodies() -> dict[str, Callable[[], bytes]]:
    state = np.array([0, 1, 1], np.uint8)
    time = np.array(TIMES)
    padded = np.zeros(3, np.dtype([("state", "u1"), ("time", "f8")], align=True))
    padded["time"], padded["state"] = time, state
    return {
        "float64": lambda: npy({"time": time, "state": state}),
        "int64": lambda: npy({"time": time.astype(np.int64), "state": state}),
        "bool": lambda: npy({"time": time, "state": state.astype(bool)}),
        "big-endian": lambda: npy({"time": time.astype(">f8"), "state": state.astype(">i4")}),
        "padded": lambda: npy_file(padded),
        "fields-swapped": lambda: npy({"state": state, "time": time}),
    }


@pytest.mark.parametrize("body", _npy_bodies().values(), ids=_npy_bodies())
def test_fields_of_npy_are_the_same_measurements(api: Api, body: Callable[[], bytes]) -> None:
    name = api.location()
    answer = api.post(f"/locations/{name}/observations", content=body(), headers={"Content-Type": NPY})
    assert done(answer, 201)["accepted"] == 3
    assert (answer.json()["first_time"], answer.json()["last_time"]) == ("2026-03-01T21:00:00Z", "2026-03-01T23:00:00Z")
    assert observed(api, name) == [0, 1, 1]


def test_arrow_keeps_microseconds(api: Api) -> None:
    name = api.location(interval_s=0.001)
    time = NOW - 1 + np.array([0.25, 0.2515])
    body = arrow({"time": time, "state": np.array([0, 1], np.uint8)})
    answer = done(api.post(f"/locations/{name}/observations", content=body, headers={"Content-Type": ARROW}), 201)
    assert answer["first_time"] == "2026-03-01T23:59:59.250000Z"
    series = done(api.get(f"/locations/{name}/series?start={time[0]}&stop={time[0] + 0.002}"))
    assert series["observed"][:2] == [0, 1]


def test_cells_are_linear_indices_or_ijk_and_both_in_one_list(api: Api) -> None:
    name = api.lab()
    answer = api.look(name, (NOW - HOUR, [5, [3, 2, 1]], [[0, 0, 1]]), (NOW - 2 * HOUR, [[0, 0, 0]], [23, 2]))
    assert answer["accepted"] == 6
    seen = {cell: observed(api, name, cell)[1:] for cell in (0, 1, 2, 5, 23, 22)}
    assert seen == {0: [1, None], 1: [None, 0], 2: [0, None], 5: [None, 1], 23: [0, 1], 22: [None, None]}


def test_cells_of_a_plane_have_two_indices(api: Api) -> None:
    name = api.location(kind="grid2d", grid={"resolution_m": 1, "shape": [3, 4]})
    api.look(name, (NOW - HOUR, [[1, 2]], [[2, 3]]))
    assert (observed(api, name, 6)[2], observed(api, name, 11)[2]) == (1, 0)


@pytest.mark.parametrize(("media_type", "encode"), [(ARROW, arrow), (NPY, npy)])
def test_columns_of_a_grid(api: Api, media_type: str, encode: Callable[[Any], bytes]) -> None:
    name = api.lab()
    columns = {
        "time": np.array([NOW - HOUR, NOW - HOUR, NOW - 2 * HOUR]),
        "cell": np.array([3, 4, 3], np.uint32),
        "state": np.array([True, False, False]),
    }
    answer = api.post(f"/locations/{name}/observations", content=encode(columns), headers={"Content-Type": media_type})
    assert done(answer, 201)["accepted"] == 3
    assert (observed(api, name, 3)[1:], observed(api, name, 4)[1:]) == ([0, 1], [None, 0])


def test_a_look_may_have_seen_only_one_kind_of_cell(api: Api) -> None:
    name = api.lab()
    form = {"observations": [{"time": NOW - HOUR, "free": [1]}, {"time": NOW - HOUR, "occupied": [2]}]}
    assert done(api.post(f"/locations/{name}/observations", form), 201)["accepted"] == 2


def test_times_may_come_late_and_out_of_order(api: Api) -> None:
    name = api.location()
    api.observe(name, TIMES[::-1], [1, 0, 1])
    assert observed(api, name) == [1, 0, 1]
    api.observe(name, [TIMES[0] - 1, TIMES[0] + 1], [1, 0])
    assert observed(api, name) == [0, 0, 1]
    api.observe(name, [TIMES[0] + 0.5], [1])
    assert observed(api, name) == [0, 0, 1], "the latest measurement of a sample stands, whenever it was posted"


def test_the_order_and_number_of_posts_do_not_matter(api: Api) -> None:
    time, state = fortnight()
    order = np.random.default_rng(1).permutation(len(time))
    whole, parts = api.location(estimator="fft", order=3), api.location(estimator="fft", order=3)
    api.observe(whole, time, state)
    for part in np.array_split(order, 5):
        api.observe(parts, time[part], state[part])
    api.update(whole), api.update(parts)
    question = f"state?time={NOW + 10 * HOUR}"
    first, second = (done(api.get(f"/locations/{name}/{question}")) for name in (whole, parts))
    assert first == second
    assert first["probability"] == pytest.approx([1], abs=0.2)


def test_a_measurement_may_be_a_little_ahead_of_the_servers_clock(api: Api) -> None:
    name = api.location()
    api.observe(name, [NOW + HOUR - 1], [1])
    refused = api.post(f"/locations/{name}/observations", {"time": [NOW, NOW + HOUR + 1], "state": [1, 1]})
    assert problem(refused, 422)["errors"][0]["field"] == "time[1]"
    api.clock.now = NOW + 2
    api.observe(name, [NOW + HOUR + 1], [1])
    assert api.facts(name)["observations"] == 2


def test_a_measurement_may_be_years_old_but_not_of_a_clock_that_is_wrong(api: Api) -> None:
    name = api.location()
    api.observe(name, [NOW - 19 * YEAR_S], [1])
    refused = api.post(f"/locations/{name}/observations", {"time": [NOW, 37], "state": [1, 1]})
    assert problem(refused, 422)["errors"] == [{"field": "time[1]", "message": TOO_OLD}]
    assert api.facts(name)["observations"] == 1


@pytest.mark.parametrize("time", [0.0, -1.0, -2208988800.0, -6e10])
def test_where_archives_may_be_of_any_age_old_times_are_times(tmp_path: Path, time: float) -> None:
    with open_house(tmp_path, past_s=1e11) as api:
        name = api.location()
        assert api.observe(name, [time], [1])["accepted"] == 1
        assert api.facts(name)["first_time"].endswith("Z")


def _gzip_in_members(body: bytes) -> bytes:
    return gzip.compress(body[:10]) + gzip.compress(b"") + gzip.compress(body[10:])


def _zstd_in_frames(body: bytes) -> bytes:
    return zstandard.compress(body[:10]) + zstandard.compress(body[10:])


def _zstd_unsized(body: bytes) -> bytes:
    packer = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    return packer.compress(body) + packer.flush()


@pytest.mark.parametrize(
    ("encoding", "pack"),
    [
        ("gzip", gzip.compress),
        ("GZIP", gzip.compress),
        ("gzip", _gzip_in_members),
        ("zstd", zstandard.compress),
        ("zstd", _zstd_in_frames),
        ("zstd", _zstd_unsized),
        ("identity", bytes),
    ],
)
@pytest.mark.parametrize("media_type", [JSON, f"{JSON}; charset=utf-8", ARROW, NPY])
def test_bodies_may_be_packed(api: Api, encoding: str, pack: Callable[[bytes], bytes], media_type: str) -> None:
    name = api.location()
    columns: dict[str, Any] = {"time": np.array(TIMES), "state": np.array([0, 1, 1], np.uint8)}
    encode = {ARROW: arrow, NPY: npy}.get(media_type, partial(orjson.dumps, option=orjson.OPT_SERIALIZE_NUMPY))
    plain = encode(columns)
    headers = {"Content-Type": media_type, "Content-Encoding": encoding}
    assert done(api.post(f"/locations/{name}/observations", content=pack(plain), headers=headers), 201)["accepted"] == 3
    assert observed(api, name) == [0, 1, 1]


@pytest.mark.parametrize("encoding", ["gzip", "zstd"])
def test_forms_may_be_packed_too(api: Api, encoding: str) -> None:
    packers: dict[str, Callable[[bytes], bytes]] = {"gzip": gzip.compress, "zstd": zstandard.compress}
    pack = packers[encoding]
    body = pack(json.dumps({"name": api.name(), "interval_s": 60}).encode())
    done(api.post("/locations", content=body, headers={"Content-Type": JSON, "Content-Encoding": encoding}), 201)


class TestIdempotencyKeys:
    """The same key and body store once; the same key with another body stores nothing."""

    FORM: ClassVar = {"time": TIMES, "state": [0, 1, 1]}

    def post(self, api: Api, name: str, form: object, key: str = "k-1", **headers: str) -> Any:
        return api.post(f"/locations/{name}/observations", form, headers={"Idempotency-Key": key, **headers})

    def test_a_repetition_is_answered_but_not_stored(self, api: Api) -> None:
        name = api.location()
        first = done(self.post(api, name, self.FORM), 201)
        assert first["duplicate"] is False
        for _ in range(3):
            again = done(self.post(api, name, self.FORM), 200)
            assert (again["duplicate"], again["anomalies"]) == (True, [])
            assert set(again) == ANSWERED
        assert api.facts(name)["observations"] == 3

    def test_another_body_is_a_conflict(self, api: Api) -> None:
        name = api.location()
        done(self.post(api, name, self.FORM), 201)
        before = api.everything()
        found = problem(self.post(api, name, {"time": TIMES, "state": [1, 1, 1]}), 409, "idempotency-key-reused")
        assert "k-1" in found["detail"]
        assert api.everything() == before

    def test_even_a_body_that_is_wrong(self, api: Api) -> None:
        name = api.location()
        done(self.post(api, name, self.FORM), 201)
        problem(self.post(api, name, {"nonsense": 1}), 409, "idempotency-key-reused")

    def test_a_refused_post_does_not_use_up_its_key(self, api: Api) -> None:
        name = api.location()
        problem(self.post(api, name, {**self.FORM, "state": [0, 1, 2]}), 422)
        assert done(self.post(api, name, self.FORM), 201)["accepted"] == 3

    def test_packing_makes_no_other_body(self, api: Api) -> None:
        name = api.location()
        plain = json.dumps(self.FORM).encode()
        how = {"Idempotency-Key": "packed", "Content-Type": JSON}
        path = f"/locations/{name}/observations"
        assert api.post(path, content=plain, headers=how).status_code == 201
        packed = api.post(path, content=gzip.compress(plain), headers={**how, "Content-Encoding": "gzip"})
        assert packed.json()["duplicate"] is True

    def test_keys_belong_to_a_location(self, api: Api) -> None:
        for name in (api.location(), api.location()):
            done(self.post(api, name, self.FORM), 201)

    def test_it_outlives_compaction_and_model(self, api: Api) -> None:
        name = api.location(estimator="fft", order=1)
        done(self.post(api, name, self.FORM), 201)
        api.update(name)
        assert done(self.post(api, name, self.FORM), 200)["revision"] == 1
        assert api.facts(name)["observations"] == 3

    @pytest.mark.parametrize("key", ["x", "y" * 255, "a b/c:d;e", "0"])
    def test_keys_may_be_what_senders_like(self, api: Api, key: str) -> None:
        name = api.location()
        done(self.post(api, name, self.FORM, key), 201)
        done(self.post(api, name, self.FORM, key), 200)

    def test_it_stores_once_when_several_send_it_at_once(self, api: Api) -> None:
        name = api.location()
        with ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(lambda _: self.post(api, name, self.FORM), range(24)))
        assert sorted(answer.status_code for answer in answers) == [200] * 23 + [201]
        assert api.facts(name)["observations"] == 3

    def test_posts_without_a_key_are_posts_of_their_own(self, api: Api) -> None:
        name = api.location()
        api.observe(name, TIMES, [0, 1, 1])
        api.observe(name, TIMES, [0, 1, 1])
        assert api.facts(name)["observations"] == 6
        assert observed(api, name) == [0, 1, 1]


SEEN = np.array([[[0, 1], [255, 255], [1, 0]]] + [[[255, 255]] * 3] * 3, np.uint8)
"""A grid of 4 x 3 x 2; four cells of it were seen."""


class TestGrids:
    """A whole grid at one time, a byte a cell."""

    def post(self, api: Api, name: str, array: Any, time: Any = NOW - HOUR, **headers: str) -> Any:
        headers = {"Content-Type": NPY, **headers}
        path = f"/locations/{name}/observations"
        return api.post(path, content=npy_file(array), params={"time": time}, headers=headers)

    @pytest.mark.parametrize(
        "array",
        [
            SEEN,
            SEEN.ravel(),
            SEEN.view(np.int8),
            np.asfortranarray(SEEN),
            np.where(SEEN == 255, -1, SEEN).astype(np.int8).ravel(),
        ],
    )
    def test_every_way_to_write_it_is_the_same(self, api: Api, array: Any) -> None:
        name = api.lab(estimator="static")
        answer = done(self.post(api, name, array), 201)
        assert (answer["accepted"], answer["first_time"], answer["last_time"]) == (4, *["2026-03-01T23:00:00Z"] * 2)
        api.update(name)
        state = done(api.get(f"/locations/{name}/state", params={"time": NOW, "observed": True}))
        assert (state["cell"], state["observed"]) == ([0, 1, 4, 5], [0, 1, 1, 0])

    def test_it_is_what_the_table_says(self, api: Api) -> None:
        """The same measurements leave the same history and the same events, whatever their form."""
        names = [api.lab(estimator="static", confidence=0.75) for _ in range(2)]
        for name in names:
            api.look(name, *((NOW - DAY + i * HOUR, [], list(range(24))) for i in range(20)))
            api.update(name)
        state = np.zeros((4, 3, 2), np.uint8)
        state[1:3, 1] = 1
        one = done(self.post(api, names[0], state, "2026-03-01T23:00:00Z"), 201)
        other = api.look(names[1], (NOW - HOUR, np.flatnonzero(state).tolist(), np.flatnonzero(state == 0).tolist()))
        assert [event["cells"] for event in one["anomalies"]] == [event["cells"] for event in other["anomalies"]] != []
        series = [done(api.get(f"/locations/{name}/series?cell=9&start={NOW - DAY}&stop={NOW}")) for name in names]
        assert series[0]["observed"] == series[1]["observed"]

    def test_of_flat_grids_of_bools_and_of_a_state(self, api: Api) -> None:
        flat = api.location(kind="grid2d", grid={"resolution_m": 1, "shape": [2, 3]})
        assert done(self.post(api, flat, np.eye(2, 3, dtype=bool)), 201)["accepted"] == 6
        assert done(self.post(api, api.location(), np.array([1], np.uint8)), 201)["accepted"] == 1

    def test_its_time_belongs_to_what_a_key_stands_for(self, api: Api) -> None:
        name, key = api.lab(), {"Idempotency-Key": "k"}
        done(self.post(api, name, SEEN, **key), 201)
        assert done(self.post(api, name, SEEN, **key), 200)["duplicate"]
        problem(self.post(api, name, SEEN, NOW - 2 * HOUR, **key), 409, "idempotency-key-reused")


def test_surprising_measurements_come_back_as_events(api: Api) -> None:
    name = api.location(estimator="fft", order=3, confidence=0.75)
    api.observe(name, *fortnight())
    api.update(name)
    answer = api.observe(name, [NOW + 600], [1], params={"source": "robot-7"})
    (event,) = answer["anomalies"]
    assert answer["revision"] == event["revision"] == 1
    assert {**event, "id": 0, "probability": 0, "surprise": 0} == {
        "id": 0,
        "location": name,
        "start": "2026-03-02T00:00:00Z",
        "stop": "2026-03-02T01:00:00Z",
        "cells": [0],
        "cells_total": 1,
        "bbox": None,
        "observed": 1,
        "parts": None,
        "probability": 0,
        "surprise": 0,
        "confidence": 0.75,
        "rule": "surprise",
        "revision": 1,
        "acknowledged_by": None,
        "acknowledged_at": None,
        "note": None,
        "ended": False,
        "muted": False,
        "snoozed_by": None,
        "snoozed_until": None,
        "change": event["id"],
    }
    assert event["surprise"] == pytest.approx(1 - event["probability"])
    assert event["surprise"] > 0.75
    assert api.observe(name, [NOW + 900], [0])["anomalies"] == []


def test_a_body_of_many_measurements(api: Api) -> None:
    name = api.location(interval_s=1)
    time = NOW - DAY + np.arange(70_000)
    columns = {"time": time, "state": (np.arange(70_000) % 2).astype(np.uint8)}
    answer = api.post(f"/locations/{name}/observations", content=arrow(columns), headers={"Content-Type": ARROW})
    assert done(answer, 201)["accepted"] == 70_000
    assert done(api.get(f"/locations/{name}/series"))["observed"] == columns["state"].tolist()
