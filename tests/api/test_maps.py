"""Questions about a map: state, predict, series, model."""

import csv
import io
import json
from datetime import datetime
from typing import Any

import httpx
import numpy as np
import pyarrow as pa
import pytest

from tests.api.house import ARROW, DAY, HOUR, NOW, NPY, Api, done, fortnight, problem
from tests.support.truth import share

NOON = NOW + 12.5 * HOUR
"""Monday, half past twelve: the door is open."""
NIGHT = NOW + 27 * HOUR
"""Three in the morning: it is closed."""
READ = 14 * 24
"""How often a door was read in a fortnight."""


def table_of(answer: httpx.Response) -> tuple[pa.Table, dict[str, Any]]:
    """The columns of an Arrow answer and the facts in its schema."""
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == ARROW
    with pa.ipc.open_stream(answer.content) as reader:
        table = reader.read_all()
    return table, json.loads(table.schema.metadata[b"tidemap"])


class TestState:
    """GET /locations/{name}/state"""

    def test_every_documented_field(self, api: Api, door: str) -> None:
        view = done(api.get(f"/locations/{door}/state?time={NOON}"))
        facts = {key: view[key] for key in view if key not in ("probability", "state", "verdict", "unavailable")}
        assert facts == {
            "time": "2026-03-02T12:30:00Z",
            "as_of": "2026-03-02T00:00:00Z",
            "given": "observations",
            "confidence": 0.75,
            "estimator": "fft",
            "order": 3,
            "revision": 1,
            "shape": [1],
            "grid": None,
            "cell": [0],
        }
        assert (view["state"], view["verdict"]) == ([1], ["occupied"])
        assert 0.75 < view["probability"][0] <= 1
        assert "observed" not in view

    def test_the_time_is_now_unless_said(self, api: Api, door: str) -> None:
        api.clock.now = NOON
        assert done(api.get(f"/locations/{door}/state"))["time"] == "2026-03-02T12:30:00Z"

    @pytest.mark.parametrize("time", [str(NOON), "2026-03-02T12:30:00Z", "2026-03-02T13:30:00%2B01:00"])
    def test_times_are_numbers_or_iso(self, api: Api, door: str, time: str) -> None:
        assert done(api.get(f"/locations/{door}/state?time={time}"))["time"] == "2026-03-02T12:30:00Z"

    def test_the_verdict_follows_the_confidence(self, api: Api, door: str) -> None:
        for time in np.arange(NOW, NOW + DAY, HOUR):
            for confidence in (0.5, 0.6, 0.75, 0.9, 0.999):
                query = f"time={time}&confidence={confidence}"
                view = done(api.get(f"/locations/{door}/state?{query}"))
                p = np.float32(view["probability"][0])
                expected = "occupied" if p > confidence else "free" if p < 1 - confidence else "uncertain"
                assert (view["verdict"], view["state"]) == ([expected], [int(p > confidence)]), query
                assert view["confidence"] == confidence

    @pytest.mark.parametrize("order", [0, 1, 3, 8, 64])
    def test_another_order_can_be_asked_for(self, api: Api, door: str, order: int) -> None:
        view = done(api.get(f"/locations/{door}/state?time={NOON}&order={order}&given=model"))
        model = done(api.get(f"/locations/{door}/model?order={order}"))
        assert view["order"] == model["order"] == order
        assert view["probability"][0] == pytest.approx(probability(model, NOON), abs=1e-5)

    def test_another_estimator_can_be_asked_for(self, api: Api, door: str) -> None:
        view = done(api.get(f"/locations/{door}/state?time={NOON}&estimator=static&given=model"))
        assert (view["estimator"], view["order"]) == ("static", 0)
        assert view["probability"][0] == pytest.approx(share(READ // 3, READ))

    def test_cells_that_were_never_seen_are_left_out(self, api: Api, lab: str) -> None:
        view = done(api.get(f"/locations/{lab}/state?time={NOON}&given=model"))
        assert view["shape"] == [4, 3, 2]
        assert view["cell"] == [0, 1, 2]
        assert view["probability"][:2] == pytest.approx([share(READ, READ), share(0, READ)])
        assert view["verdict"] == ["occupied", "free", "occupied"]

    def test_observed_adds_what_was_last_seen_by_then(self, api: Api, door: str) -> None:
        def last_seen(time: float) -> tuple[Any, Any]:
            view = done(api.get(f"/locations/{door}/state?time={time}&observed=true"))
            return view["observed"][0], view["observed_time"][0]

        begin = NOW - 14 * DAY
        assert last_seen(begin - 1) == (None, None)
        assert last_seen(begin) == (0, begin)
        assert last_seen(begin + 9.9 * HOUR) == (1, begin + 9 * HOUR)
        assert last_seen(NOW) == (0, NOW - HOUR)
        assert last_seen(NOW + 365 * DAY) == (0, NOW - HOUR)
        assert last_seen(5e10) == (0, NOW - HOUR)

    def test_a_box_leaves_out_the_cells_whose_centre_is_outside(self, api: Api, lab: str) -> None:
        def cells(box: str) -> list[int]:
            return list(done(api.get(f"/locations/{lab}/state?bbox={box}"))["cell"])

        assert cells("10,20,0,12,21.5,1") == [0, 1, 2]
        assert cells("10,20,0,10.5,20.5,0.5") == [0]
        assert cells("10,20,0.5,10.5,20.5,1") == [1]
        assert cells("10,20.5,0,10.5,21,0.5") == [2]
        assert cells("-1e9,-1e9,-1e9,0,0,0") == []

    def test_arrow_has_the_same_columns(self, api: Api, lab: str) -> None:
        for query in (f"time={NOON}", f"time={NOON}&observed=true", f"time={NOW - 15 * DAY}&observed=true"):
            view = done(api.get(f"/locations/{lab}/state?{query}"))
            table, facts = table_of(api.get(f"/locations/{lab}/state?{query}", headers={"Accept": ARROW}))
            columns = {name: column.to_pylist() for name, column in zip(table.column_names, table.columns, strict=True)}
            assert {**facts, **{k: pytest.approx(v) if k == "probability" else v for k, v in columns.items()}} == view

    def test_npy_is_the_dense_grid(self, api: Api, lab: str) -> None:
        answer = api.get(f"/locations/{lab}/state?time={NOON}", headers={"Accept": NPY})
        assert answer.headers["content-type"] == NPY
        assert answer.headers["tidemap-revision"] == "1"
        dense = np.load(io.BytesIO(answer.content), allow_pickle=False)
        assert (dense.shape, dense.dtype) == ((4, 3, 2), np.float32)
        view = done(api.get(f"/locations/{lab}/state?time={NOON}"))
        assert dense.ravel()[:3].tolist() == pytest.approx(view["probability"])
        assert np.isnan(dense.ravel()[3:]).all()
        np.save(saved := io.BytesIO(), dense)
        assert saved.getvalue() == answer.content

    def test_npy_of_a_box_is_as_large_and_unknown_outside(self, api: Api, lab: str) -> None:
        box, seen = "bbox=10,20,0.5,10.5,20.5,1", "observed=true"
        whole, part, observed = (
            np.load(io.BytesIO(api.get(f"/locations/{lab}/state?time={NOON}&{how}", headers={"Accept": NPY}).content))
            for how in ("", box, seen)
        )
        inside = np.zeros((4, 3, 2), np.bool_)
        inside[0, 0, 1] = True
        np.testing.assert_array_equal(part, np.where(inside, whole, np.nan))
        np.testing.assert_array_equal(observed, whole)

    @pytest.mark.parametrize(
        ("accept", "given"),
        [
            ("*/*", "application/json"),
            ("", "application/json"),
            ("text/html, application/json;q=0.9", "application/json"),
            (f"{ARROW};q=1, application/json", ARROW),
            (f"text/plain, {NPY}", NPY),
        ],
    )
    def test_accept_chooses_the_form(self, api: Api, lab: str, accept: str, given: str) -> None:
        answer = api.get(f"/locations/{lab}/state", headers={"Accept": accept})
        assert (answer.status_code, answer.headers["content-type"]) == (200, given)

    def test_an_answer_that_is_held_already_is_not_sent_again(self, api: Api) -> None:
        name = api.location(estimator="fft", order=3, confidence=0.75)
        api.observe(name, *fortnight())
        api.update(name)
        asked = f"/locations/{name}/state?time={NOON}"
        first = api.get(asked)
        etag = first.headers["etag"]
        held = {"If-None-Match": etag}
        again = api.get(asked, headers=held)
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", etag)
        assert api.get(asked, headers={"If-None-Match": f'"other", W/{etag}'}).status_code == 304

        for other in (
            f"{asked}&confidence=0.8",
            f"{asked}&order=1",
            f"{asked}&estimator=static",
            asked.replace(str(NOON), str(NOON + 1)),
        ):
            assert api.get(other, headers=held).status_code == 200, other
        assert api.get(asked, headers={**held, "Accept": ARROW}).status_code == 200
        done(api.patch(f"/locations/{name}", {"confidence": 0.8}))
        assert api.get(asked, headers=held).status_code == 200
        done(api.patch(f"/locations/{name}", {"confidence": 0.75}))
        assert api.get(asked, headers=held).status_code == 304
        api.update(name)
        assert api.get(asked, headers=held).status_code == 200

    def test_observed_answers_follow_the_observations(self, api: Api) -> None:
        name = api.location(estimator="static")
        api.observe(name, [NOW - DAY], [0])
        api.update(name)
        asked = f"/locations/{name}/state?time={NOW}&observed=true"
        first = api.get(asked)
        assert first.json()["observed"] == [0]
        api.observe(name, [NOW - HOUR], [1])
        held = {"If-None-Match": first.headers.get("etag", '"none"')}
        assert done(api.get(asked, headers=held))["observed"] == [1]


class TestGiven:
    """What was read last, in the answers of `state` and `predict`."""

    @pytest.fixture
    def noon(self, api: Api) -> str:
        """A door that is open every day from 8 to 16, but some days closed for hours, and is found closed at eleven."""
        name = api.location(estimator="fft", order=3, confidence=0.75)
        time, state = fortnight()
        day, hour = np.divmod(np.arange(READ), 24)
        away = (day % 3 == 0) & (hour >= 9 + day % 4) & (hour < 12 + day % 4)
        api.observe(name, time, state & ~away)
        api.update(name)
        api.clock.now = NOW + 11.4 * HOUR
        api.observe(name, [NOW + 11.2 * HOUR], [0])
        return name

    def p(self, api: Api, name: str, time: float, **how: Any) -> float:
        """Of `state`, as `predict` says it, too."""
        view = done(api.get(f"/locations/{name}/state", params={"time": time, **how}))
        answer = done(api.post(f"/locations/{name}/predict", {"time": [NIGHT, time], **how}))
        assert answer["probability"][0][1] == pytest.approx(view["probability"][0], abs=1e-6)
        assert (answer["as_of"], answer["given"]) == (view["as_of"], view["given"])
        return float(view["probability"][0])

    def test_what_was_read_just_now_counts_and_less_and_less(self, api: Api, noon: str) -> None:
        assert self.p(api, noon, NOW + 12 * HOUR, given="model") > 0.8
        soon, later, next_day = (self.p(api, noon, NOW + hour * HOUR) for hour in (11.3, 13, 36))
        assert soon < 0.3 < later < self.p(api, noon, NOW + 13 * HOUR, given="model")
        assert next_day == pytest.approx(self.p(api, noon, NOW + 36 * HOUR, given="model"), abs=0.15)

    def test_before_the_reading_it_is_the_model(self, api: Api, noon: str) -> None:
        for time in (NOW - 3 * DAY, NOW + 11 * HOUR, NOW + 11.2 * HOUR):
            model = self.p(api, noon, time, given="model")
            assert self.p(api, noon, time) == model or time > NOW
        assert self.p(api, noon, NOW + 11.2 * HOUR, as_of=NOW + 11.2 * HOUR) == self.p(
            api, noon, NOW + 11.2 * HOUR, given="model"
        )

    def test_as_of_an_earlier_moment_later_readings_are_not_known(self, api: Api, noon: str) -> None:
        before = self.p(api, noon, NOW + 12 * HOUR, as_of=NOW + 11.1 * HOUR)
        after = self.p(api, noon, NOW + 12 * HOUR, as_of=NOW + 11.2 * HOUR)
        assert after < 0.7 < before
        text = self.p(api, noon, NOW + 12 * HOUR, as_of="2026-03-02T11:12:00Z")
        assert text == after

    def test_of_two_readings_in_a_sample_the_one_that_was_known_then_counts(self, api: Api, noon: str) -> None:
        api.clock.now = NOW + 12 * HOUR
        before = self.p(api, noon, NOW + 13 * HOUR, as_of=NOW + 11.7 * HOUR)
        api.observe(noon, [NOW + 11.8 * HOUR], [1])
        assert self.p(api, noon, NOW + 13 * HOUR) > 0.8
        # Of a sample the latest reading stands: as of an earlier moment nothing of that sample is known any more.
        assert self.p(api, noon, NOW + 13 * HOUR, as_of=NOW + 11.7 * HOUR) != before
        api.observe(noon, [NOW + 10.5 * HOUR], [0])
        model = self.p(api, noon, NOW + 13 * HOUR, given="model")
        assert self.p(api, noon, NOW + 13 * HOUR, as_of=NOW + 10.7 * HOUR) < model

    def test_late_data_change_the_answer(self, api: Api, noon: str) -> None:
        before = self.p(api, noon, NOW + 12 * HOUR)
        api.observe(noon, [NOW + 10 * HOUR], [1])
        assert self.p(api, noon, NOW + 12 * HOUR) < before, "it was closed lately, and stays so for hours"

    def test_what_is_held_was_read_as_long_as_it_stands(self, api: Api) -> None:
        answers = []
        for how in ({}, {"missing": "hold", "hold_s": DAY}):
            name = api.location(estimator="static", **how)
            api.observe(name, *fortnight())
            api.update(name)
            api.clock.now = NOW + 2 * HOUR
            api.observe(name, [NOW + 2 * HOUR], [1])
            api.clock.now = NOW + 7 * HOUR
            answers.append(self.p(api, name, NOW + 8.5 * HOUR))
            api.clock.now = NOW
        assert answers[1] > answers[0]

    def test_each_cell_has_its_own_reading(self, api: Api, lab: str) -> None:
        view = done(api.get(f"/locations/{lab}/state?time={NOON}&last_seen=true"))
        assert view["last_seen"] == [NOW - HOUR] * 3
        early = done(api.get(f"/locations/{lab}/state?time={NOON}&last_seen=true&as_of={NOW - 20 * DAY}"))
        assert early["last_seen"] == [None] * 3
        model = done(api.get(f"/locations/{lab}/state?time={NOON}&given=model"))
        assert early["probability"] == model["probability"]
        assert "last_seen" not in model

    def test_arrow_and_npy_say_the_same(self, api: Api, lab: str) -> None:
        asked = f"/locations/{lab}/state?time={NOON}&last_seen=true"
        view = done(api.get(asked))
        table, facts = table_of(api.get(asked, headers={"Accept": ARROW}))
        assert (facts["as_of"], facts["given"]) == (view["as_of"], view["given"])
        assert table["probability"].to_pylist() == pytest.approx(view["probability"])
        assert table["last_seen"].to_pylist() == view["last_seen"]
        dense = np.load(io.BytesIO(api.get(asked, headers={"Accept": NPY}).content))
        assert dense.ravel()[:3].tolist() == pytest.approx(view["probability"])

    def test_an_answer_is_sent_again_when_something_was_read(self, api: Api, noon: str) -> None:
        asked = f"/locations/{noon}/state?time={NOW + 12 * HOUR}"
        held = {"If-None-Match": api.get(asked).headers["etag"]}
        api.clock.now += 60
        assert api.get(asked, headers=held).status_code == 304, "nothing was read meanwhile"
        assert api.get(f"{asked}&as_of={NOW}", headers=held).status_code == 200
        api.observe(noon, [api.clock.now], [1])
        assert api.get(asked, headers=held).status_code == 200

    def test_what_is_no_moment_and_no_choice_is_refused(self, api: Api, door: str) -> None:
        problem(api.get(f"/locations/{door}/state?as_of=yesterday"), 422)
        problem(api.get(f"/locations/{door}/state?given=nothing"), 422)
        problem(api.post(f"/locations/{door}/predict", {"time": [NOW], "as_of": "yesterday"}), 422)
        problem(api.post(f"/locations/{door}/predict", {"time": [NOW], "given": "nothing"}), 422)


class TestPredict:
    """POST /locations/{name}/predict"""

    def test_every_documented_field(self, api: Api, lab: str) -> None:
        form = {"time": [NOON, "2026-03-03T03:00:00Z"], "cell": [2, 0, 5], "given": "model"}
        answer = done(api.post(f"/locations/{lab}/predict", form))
        assert (answer["time"], answer["cell"], answer["revision"]) == ([NOON, NIGHT], [2, 0, 5], 1)
        assert np.shape(answer["probability"]) == np.shape(answer["state"]) == np.shape(answer["entropy"]) == (3, 2)
        assert answer["probability"][1] == pytest.approx([share(READ, READ)] * 2)
        assert (answer["as_of"], answer["given"]) == ("2026-03-02T00:00:00Z", "model")
        assert answer["state"] == [[1, 0], [1, 1], [None, None]]
        assert answer["probability"][2] == answer["entropy"][2] == [None, None]
        assert 0 < answer["entropy"][1][0] < 0.1

    def test_it_agrees_with_state(self, api: Api, lab: str) -> None:
        early, model = {"as_of": NOW - 2.5 * DAY}, {"given": "model"}
        for how in ({}, {"order": 1}, {"estimator": "static"}, {"confidence": 0.99}, early, model):
            answer = done(api.post(f"/locations/{lab}/predict", {"time": [NOON], "cell": [0, 1, 2], **how}))
            view = done(api.get(f"/locations/{lab}/state", params={"time": NOON, **how}))
            assert [row[0] for row in answer["probability"]] == pytest.approx(view["probability"], abs=1e-6)
            assert [row[0] for row in answer["state"]] == view["state"]
            assert answer["confidence"] == view["confidence"]

    def test_all_cells_unless_said(self, api: Api, lab: str) -> None:
        answer = done(api.post(f"/locations/{lab}/predict", {"time": [NOON]}))
        assert answer["cell"] == list(range(24))
        assert answer["probability"][3:] == [[None]] * 21

    def test_entropy_is_in_bits(self, api: Api, door: str) -> None:
        answer = done(api.post(f"/locations/{door}/predict", {"time": list(NOW + HOUR * np.arange(24))}))
        p = np.array(answer["probability"][0])
        both = np.stack([p, 1 - p])
        bits = -np.sum(both * np.log2(both, out=np.zeros_like(both), where=both > 0), axis=0)
        assert answer["entropy"][0] == pytest.approx(bits.tolist(), abs=1e-6)

    @pytest.mark.parametrize("copies", [1, 12_000], ids=["a few", "more than are parsed at once"])
    def test_cells_are_linear_or_indices(self, api: Api, lab: str, copies: int) -> None:
        answers = [
            done(api.post(f"/locations/{lab}/predict", {"time": [NOON], "cell": cell * copies}))
            for cell in ([2, 0, 9], [[0, 1, 0], 0, [1, 1, 1]], [[0, 1, 0], [0, 0, 0], [1, 1, 1]])
        ]
        assert answers[0]["cell"] == [2, 0, 9] * copies
        assert answers[0] == answers[1] == answers[2]

    def test_cells_outside_are_not_found(self, api: Api, lab: str) -> None:
        for cell in (-1, 24, 2**40, [4, 0, 0], [0, -1, 0]):
            found = problem(api.post(f"/locations/{lab}/predict", {"time": [NOON], "cell": [0, cell]}), 404)
            assert f"Cell {cell} is outside" in found["detail"]
            assert "0 to 23" in found["detail"]


class TestSeries:
    """GET /locations/{name}/series"""

    def test_without_a_range_it_is_the_whole_history(self, api: Api, door: str) -> None:
        time, state = fortnight()
        answer = done(api.get(f"/locations/{door}/series"))
        assert answer["time"] == time.tolist()
        assert answer["observed"] == state.tolist()
        assert answer["revision"] == 1
        assert answer["state"] == [int(p > 0.75) for p in answer["probability"]]

    def test_a_range_is_half_open_and_stepped(self, api: Api, door: str) -> None:
        answer = done(api.get(f"/locations/{door}/series?start={NOW}&stop={NOW + 3600}&step=900"))
        assert answer["time"] == [NOW, NOW + 900, NOW + 1800, NOW + 2700]
        assert answer["observed"] == [None] * 4
        assert done(api.get(f"/locations/{door}/series?start={NOW}&stop={NOW}"))["time"] == []

    def test_samples_that_nobody_saw_are_null(self, api: Api, lab: str) -> None:
        for cell, expected in ((0, 1), (1, 0), (5, None)):
            answer = done(api.get(f"/locations/{lab}/series?cell={cell}&start={NOW - DAY}&stop={NOW}"))
            assert answer["observed"] == [expected] * 24
            assert answer["cell"] == cell
        assert answer["probability"] == answer["state"] == [None] * 24

    def test_as_a_table_it_has_a_header_units_and_the_zone(self, api: Api, door: str) -> None:
        unfitted = api.location(time_zone="Asia/Kolkata")
        api.observe(unfitted, [NOW - HOUR], [1])
        for name, zone, offset in ((door, "UTC", "+00:00"), (unfitted, "Asia/Kolkata", "+05:30")):
            path = f"/locations/{name}/series?start={NOW - HOUR}&stop={NOW + HOUR}&step=1800"
            found = api.get(path, headers={"Accept": "text/csv"})
            assert found.headers["content-type"].startswith("text/csv")
            assert f'filename="{name}-0.csv"' in found.headers["content-disposition"]
            rows = list(csv.DictReader(found.text.splitlines()))
            assert list(rows[0]) == ["time_s", "local_time", "time_zone", "cell", "probability", "state", "observed"]
            answer = done(api.get(path))
            assert [float(row["time_s"]) for row in rows] == answer["time"]
            assert {(row["time_zone"], row["local_time"][-6:]) for row in rows} == {(zone, offset)}
            assert [datetime.fromisoformat(row["local_time"]).timestamp() for row in rows] == answer["time"]
            for column in ("probability", "state", "observed"):
                values = [float(row[column]) if row[column] else None for row in rows]
                assert values == [each if each is None else pytest.approx(each, abs=1e-6) for each in answer[column]]

    def test_before_the_first_model_only_the_observations_are_known(self, api: Api) -> None:
        name = api.location()
        assert done(api.get(f"/locations/{name}/series"))["time"] == []
        api.observe(name, [NOW - 2 * HOUR], [1])
        answer = done(api.get(f"/locations/{name}/series?start={NOW - 2 * HOUR}&stop={NOW}"))
        assert (answer["observed"], answer["probability"], answer["revision"]) == ([1, None], [None, None], 0)

    def test_held_states_are_observed_until_their_time_is_up(self, api: Api) -> None:
        name = api.location(missing="hold", hold_s=2 * HOUR)
        api.observe(name, [NOW - 6 * HOUR, NOW - HOUR], [1, 0])
        answer = done(api.get(f"/locations/{name}/series"))
        assert answer["observed"] == [1, 1, 1, None, None, 0, 0], "it is held until now"


class TestDensity:
    """GET /locations/{name}/density"""

    def test_it_says_how_much_was_observed_when_and_answers_a_known_version_with_304(self, api: Api) -> None:
        name = api.location()
        assert done(api.get(f"/locations/{name}/density"))["measurements"] == []
        api.observe(name, [NOW - 5 * HOUR, NOW - 4 * HOUR, NOW - HOUR], [1, 0, 0])
        path = f"/locations/{name}/density?start={NOW - 6 * HOUR}&stop={NOW}&bins=3"
        first = api.get(path)
        answer = done(first)
        assert answer["measurements"] == answer["samples"] == [1, 1, 1]
        assert answer["time"] == [NOW - 6 * HOUR, NOW - 4 * HOUR, NOW - 2 * HOUR]
        assert (answer["step_s"], answer["step_samples"], answer["cells"]) == (2 * HOUR, 2, 1)
        known = {"If-None-Match": first.headers["etag"]}
        assert api.get(path, headers=known).status_code == 304
        api.observe(name, [NOW - 2 * HOUR], [1])
        assert done(api.get(path, headers=known))["measurements"] == [1, 1, 2]


def probability(model: dict[str, Any], time: float) -> float:
    """p(t) by the formula that the answer documents: that of the sample that contains t."""
    sample = time // model["interval_s"] * model["interval_s"]
    since = sample - np.datetime64(model["start"].removesuffix("Z")).astype("datetime64[us]").astype(float) / 1e6
    waves = (c["amplitude"] * np.cos(2 * np.pi * c["frequency_hz"] * since + c["phase"]) for c in model["components"])
    return float(np.clip(model["mean"] + sum(waves), 0, 1))


class TestModel:
    """GET /locations/{name}/model"""

    def test_every_documented_field(self, api: Api, door: str) -> None:
        model = done(api.get(f"/locations/{door}/model"))
        facts = ("estimator", "link", "order", "start", "stop", "samples", "interval_s", "revision", "selection")
        assert {name: model[name] for name in facts} == {
            "estimator": "fft",
            "link": "identity",
            "order": 3,
            "start": "2026-02-16T00:00:00Z",
            "stop": "2026-03-02T00:00:00Z",
            "samples": 14 * 24,
            "interval_s": HOUR,
            "revision": 1,
            "selection": None,
        }
        assert model["mean"] == pytest.approx(share(READ // 3, READ))
        assert [set(each) for each in model["components"]] == [
            {"amplitude", "phase", "frequency_hz", "period_s", "gate"}
        ] * 3
        assert set(model["compression"]) >= {
            "samples",
            "history_bytes",
            "spectrum_bytes",
            "lossy_ratio",
            "lossless_ratio",
        }

    def test_components_are_periods_greatest_first(self, api: Api, door: str) -> None:
        components = done(api.get(f"/locations/{door}/model?order=6"))["components"]
        amplitudes = [each["amplitude"] for each in components]
        assert amplitudes == sorted(amplitudes, reverse=True)
        assert components[0]["period_s"] == pytest.approx(DAY)
        for each in components:
            assert each["period_s"] * each["frequency_hz"] == pytest.approx(1)
            assert DAY / each["period_s"] == pytest.approx(round(DAY / each["period_s"])), "harmonics of the day"

    @pytest.mark.parametrize("order", [0, 1, 2, 3, 7, 15, 64])
    def test_components_and_outliers_give_back_the_history(self, api: Api, order: int) -> None:
        name = api.location(estimator="fft", order=3)
        time, state = fortnight()
        noisy = state ^ (np.random.default_rng(order).random(len(state)) < 0.1)
        api.observe(name, time, noisy)
        api.update(name)
        model = done(api.get(f"/locations/{name}/model?order={order}"))
        assert len(model["components"]) <= order
        rebuilt = np.array([probability(model, t) > 0.5 for t in time])
        wrong = np.zeros(len(time), bool)
        for start, stop in model["outliers"]:
            assert start < stop
            wrong |= (time >= start) & (time < stop)
        np.testing.assert_array_equal(rebuilt ^ wrong, noisy)
        assert model["accuracy"] == pytest.approx(1 - wrong.mean())

    def test_asking_at_another_order_stores_nothing(self, api: Api, door: str) -> None:
        before = done(api.get(f"/locations/{door}/model"))
        assert done(api.get(f"/locations/{door}/model?order=9"))["order"] == 9
        assert done(api.get(f"/locations/{door}/model")) == before
        assert api.facts(door)["revision"] == 1

    def test_auto_says_what_it_chose_and_why(self, api: Api) -> None:
        name = api.location()
        api.observe(name, *fortnight())
        api.update(name)
        selection = done(api.get(f"/locations/{name}/model"))["selection"]
        assert selection["estimator"] != "static"
        assert len(selection["reason"]) > 10
        assert {(row["estimator"], row["order"]) for row in selection["scores"]} >= {("static", 0), ("fft", 1)}
        assert all({"error", "brier", "log_loss", "n"} <= row.keys() for row in selection["scores"])

    def test_a_sensor_that_errs_says_where_its_rates_come_from(self, api: Api) -> None:
        name = api.location(sensor="learn")
        times = NOW - HOUR * np.arange(300, 0, -1)
        truth = np.arange(300) // 30 % 2
        wrong = np.arange(300) % 10 == 0
        api.observe(name, times, truth ^ wrong)
        api.update(name)
        found = done(api.get(f"/locations/{name}/model"))["sensor"]
        assert 0.02 < found["miss"] < 0.2
        assert 0.02 < found["false_alarm"] < 0.2
        assert found["readings"] == 300
        assert found["reason"] == "the rates were learned from 300 readings of 1 cell"
        assert done(api.patch(f"/locations/{name}", {"sensor": {"miss": 0.3, "false_alarm": 0.1}}))["sensor"] == {
            "miss": 0.3,
            "false_alarm": 0.1,
        }
        api.update(name)
        given = done(api.get(f"/locations/{name}/model"))["sensor"]
        assert given == {"miss": 0.3, "false_alarm": 0.1, "readings": 0, "reason": "the rates were given"}

    def test_with_too_little_history_auto_takes_the_mean_and_says_so(self, api: Api) -> None:
        name = api.location()
        api.observe(name, [NOW - HOUR], [1])
        api.update(name)
        model = done(api.get(f"/locations/{name}/model"))
        assert (model["estimator"], model["components"], model["mean"]) == ("static", [], share(1, 1))
        assert "history" in model["selection"]["reason"] or "little" in model["selection"]["reason"]

    def test_of_a_cell_that_was_never_seen(self, api: Api, lab: str) -> None:
        model = done(api.get(f"/locations/{lab}/model?cell=9"))
        assert (model["mean"], model["components"], model["outliers"], model["accuracy"]) == (None, [], [], None)

    def test_compression_figures_are_honest(self, api: Api, door: str) -> None:
        figures = done(api.get(f"/locations/{door}/model"))["compression"]
        assert figures["samples"] == 14 * 24
        assert figures["raw_bytes"] == 14 * 3
        assert figures["lossy_ratio"] == pytest.approx(figures["raw_bytes"] / figures["spectrum_bytes"])
        assert figures["lossless_ratio"] == pytest.approx(figures["raw_bytes"] / figures["history_bytes"])


@pytest.mark.parametrize("question", ["state", "model"])
def test_without_a_revision_there_is_no_model(api: Api, question: str) -> None:
    found = problem(api.get(f"/locations/{api.location()}/{question}"), 409)
    assert found["type"].endswith("no-model")
    assert "update" in found["detail"]


@pytest.mark.parametrize("question", ["predict", "evaluate", "anomalies/detect"])
def test_nor_for_questions_with_a_form(api: Api, question: str) -> None:
    form = {"predict": {"time": [1]}, "evaluate": {"orders": [1]}, "anomalies/detect": {"start": 0, "stop": 1}}
    found = problem(api.post(f"/locations/{api.location()}/{question}", form[question]), 409)
    assert found["type"].endswith("no-model")


@pytest.mark.parametrize("question", ["series", "model"])
@pytest.mark.parametrize("cell", [-1, 24, 10**30])
def test_cells_outside_are_not_found(api: Api, lab: str, question: str, cell: int) -> None:
    found = problem(api.get(f"/locations/{lab}/{question}?cell={cell}"), 404, "cell-not-found")
    assert "0 to 23" in found["detail"]


def test_an_answer_that_changed_has_another_tag(api: Api) -> None:
    name = api.location(estimator="static", missing="hold", hold_s=10 * HOUR)
    time, state = fortnight()
    api.observe(name, time, state)
    api.update(name)
    asked = f"/locations/{name}/state?time={NOW + HOUR}&last_seen=true"
    tag = api.get(asked).headers["etag"]

    def changed() -> bool:
        nonlocal tag
        before, tag = tag, api.get(asked).headers["etag"]
        return bool(before != tag)

    assert not changed()
    done(api.request("PATCH", f"/locations/{name}", json={"missing": "mask"}))
    assert changed()
    done(api.request("DELETE", f"/locations/{name}/observations?start={time[3]}&stop={time[3] + 1}"))
    assert changed()
