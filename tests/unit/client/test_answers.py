"""Answers as arrays."""

import json
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tidemap.client import answers
from tidemap.media_types import ARROW

META: dict[str, Any] = {
    "time": "2026-03-01T09:00:00Z",
    "as_of": "2026-03-01T08:00:00Z",
    "given": "observations",
    "confidence": 0.9,
    "estimator": "fft",
    "order": 3,
    "revision": 7,
    "shape": [2, 2],
    "unavailable": [[1, 3]],
}


def state_bytes(**columns: pa.Array) -> bytes:
    batch = pa.RecordBatch.from_pydict(columns).replace_schema_metadata({"tidemap": json.dumps(META)})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return bytes(sink.getvalue())


def columns(**more: pa.Array) -> dict[str, pa.Array]:
    return {
        "cell": pa.array([0, 3], pa.uint32()),
        "probability": pa.array([0.25, 1.0], pa.float32()),
        "state": pa.array([0, 1], pa.uint8()),
        "verdict": pa.array(["uncertain", "occupied"]),
    } | more


def test_a_state_carries_its_columns_and_metadata() -> None:
    state = answers.state(state_bytes(**columns()), ARROW)
    assert (state.time, state.revision, state.shape, state.order) == (1772355600, 7, (2, 2), 3)
    assert (state.estimator, state.confidence) == ("fft", 0.9)
    assert state.verdict.tolist() == ["uncertain", "occupied"]
    assert (state.observed, state.observed_time, state.last_seen) == (None, None, None)
    assert (state.as_of, state.given) == (1772352000, "observations")
    assert state.unavailable.tolist() == [[1, 3]]


def test_verdicts_may_be_dictionary_encoded() -> None:
    verdict = pa.DictionaryArray.from_arrays(pa.array([2, 1], pa.uint8()), ["free", "occupied", "uncertain"])
    assert answers.state(state_bytes(**columns(verdict=verdict)), ARROW).verdict.tolist() == [
        "uncertain",
        "occupied",
    ]


def test_dense_puts_cells_in_c_order_and_leaves_the_unknown_unknown() -> None:
    state = answers.state(state_bytes(**columns()), ARROW)
    np.testing.assert_array_equal(state.dense(), np.array([[0.25, np.nan], [np.nan, 1]], np.float32))
    np.testing.assert_array_equal(state.dense("state"), [[0, -1], [-1, 1]])


def test_what_was_never_observed_is_minus_one_and_nan() -> None:
    state = answers.state(
        state_bytes(**columns(observed=pa.array([None, 1], pa.uint8()), observed_time=pa.array([None, 60.0]))), ARROW
    )
    assert state.observed is not None
    assert state.observed_time is not None
    assert state.observed.tolist() == [answers.UNKNOWN, 1]
    np.testing.assert_array_equal(state.observed_time, [np.nan, 60])


def test_a_column_that_was_not_asked_for_says_how_to_get_it() -> None:
    with pytest.raises(ValueError, match="observed=True"):
        answers.state(state_bytes(**columns()), ARROW).dense("observed")


def test_an_empty_state_is_no_error() -> None:
    empty = {name: column.slice(0, 0) for name, column in columns().items()}
    state = answers.state(state_bytes(**empty), ARROW)
    assert (len(state.cell), len(state.verdict)) == (0, 0)
    assert np.isnan(state.dense()).all()


def test_a_prediction_is_cells_by_times() -> None:
    said = {
        "time": [0.0, 60.0, 120.0],
        "cell": [4, 9],
        "confidence": 0.9,
        "probability": [[0.0, 0.5, 1.0], [None, None, None]],
        "state": [[0, 0, 1], [None, None, None]],
        "entropy": [[0.0, 1.0, 0.0], [None, None, None]],
        "as_of": "2026-03-01T08:00:00Z",
        "given": "model",
        "revision": 2,
        "unavailable": [[5, 8], [9, 10]],
    }
    prediction = answers.prediction(json.dumps(said).encode())
    assert prediction.probability.shape == prediction.state.shape == prediction.entropy.shape == (2, 3)
    assert prediction.probability[0].tolist() == [0, 0.5, 1]
    assert prediction.state.tolist() == [[0, 0, 1], [-1, -1, -1]]
    assert np.isnan(prediction.entropy[1]).all()
    assert prediction.unavailable.tolist() == [[5, 8], [9, 10]]
    assert (prediction.cell.tolist(), prediction.revision, prediction.confidence) == ([4, 9], 2, 0.9)
    assert (prediction.as_of, prediction.given) == (1772352000, "model")


def test_a_prediction_of_no_cells_keeps_its_shape() -> None:
    said = {
        "time": [0.0],
        "cell": [],
        "confidence": 0.9,
        "probability": [],
        "state": [],
        "entropy": [],
        "as_of": "2026-03-01T08:00:00Z",
        "given": "model",
        "revision": 1,
        "unavailable": [],
    }
    prediction = answers.prediction(json.dumps(said).encode())
    assert (prediction.probability.shape, prediction.unavailable.shape) == ((0, 1), (0, 2))


def test_a_series_marks_what_is_unknown() -> None:
    said = {
        "cell": 1,
        "time": [0, 60],
        "probability": [0.5, None],
        "state": [0, None],
        "observed": [None, 1],
        "revision": 0,
    }
    series = answers.series(json.dumps(said).encode())
    assert (series.state.tolist(), series.observed.tolist(), series.cell) == ([0, -1], [-1, 1], 1)
    assert np.isnan(series.probability[1])


def test_json_says_the_same_as_arrow() -> None:
    seen = columns(observed=pa.array([1, None], pa.int8()), observed_time=pa.array([60.0, None]))
    seen["last_seen"] = pa.array([None, 120.0])
    said = META | {name: column.to_pylist() for name, column in seen.items()}
    one, other = answers.state(state_bytes(**seen), ARROW), answers.state(json.dumps(said).encode(), "application/json")
    for name in ("cell", "probability", "state", "verdict", "observed", "observed_time", "last_seen", "unavailable"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert getattr(one, name).dtype.kind == getattr(other, name).dtype.kind
    assert (one.time, one.shape, one.revision) == (other.time, other.shape, other.revision)


@pytest.mark.parametrize(
    ("disposition", "name"),
    [
        ('attachment; filename="hall.pcd"', "hall.pcd"),
        ("attachment; filename=hall.pcd", "hall.pcd"),
        ('attachment; filename="../../.ssh/authorized_keys"', "authorized_keys"),
        ('attachment; filename="/etc/hall.pcd"', "hall.pcd"),
        ('attachment; filename="..\\..\\hall.pcd"', "hall.pcd"),
        ('attachment; filename="C:hall.pcd"', "hall.pcd"),
        *(
            (f'attachment; filename="{name}"', answers.UNNAMED)
            for name in ("", ".", "..", "a/..", "a/", "a\0b", "a\nb")
        ),
        ("attachment", answers.UNNAMED),
        (None, answers.UNNAMED),
    ],
)
def test_a_file_is_named_without_folders(disposition: str | None, name: str) -> None:
    headers = {"Tidemap-Time": META["time"], "Tidemap-Revision": "1"}
    if disposition is not None:
        headers["Content-Disposition"] = disposition
    assert answers.map_file(b"", headers).name == name
