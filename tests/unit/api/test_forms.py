"""Forms with long columns: read in pieces, and as if they were read at once."""

import json
from typing import Any

import pytest
from fastapi.exceptions import RequestValidationError
from hypothesis import given
from hypothesis import strategies as st

from tidemap.api.forms import read_form
from tidemap.errors import InvalidInputError, UnreadableBodyError
from tidemap.formats.json_columns.text import PIECE_BYTES
from tidemap.schemas.maps import EvaluateForm, PredictForm

LONG = 5 * PIECE_BYTES
TIMES = st.one_of(
    st.lists(st.floats(-1e9, 1e9) | st.integers(-(10**9), 10**9), min_size=1, max_size=30),
    st.lists(
        st.sampled_from(["2026-03-01T09:00:00Z", "2026-03-01T09:00:00+01:00", "2026-03-01T10:30:00.5Z"]),
        min_size=1,
        max_size=30,
    ),
    st.lists(st.sampled_from([1.5, "2026-03-01T09:00:00Z"]), min_size=1, max_size=30),
)


@given(times=TIMES, separators=st.sampled_from([(",", ":"), (", ", ": "), (" ,\n", " : ")]))
def test_a_long_form_says_what_a_short_one_says(times: list[Any], separators: tuple[str, str]) -> None:
    many = times * (1 + PIECE_BYTES // len(json.dumps(times)) * 3)
    content = json.dumps({"confidence": 0.75, "time": many}, separators=separators).encode()
    assert len(content) > PIECE_BYTES
    short = read_form(json.dumps({"time": times}).encode(), PredictForm)
    long = read_form(content, PredictForm)
    assert long.time == short.time * (len(many) // len(times))
    assert (long.confidence, long.cell) == (0.75, None)


@pytest.mark.parametrize(
    ("content", "error", "says"),
    [
        (b'{"time": [%s 1], "tiem": 1}' % (b"1," * LONG), InvalidInputError, "tiem"),
        (b"{%s}" % b",".join(b'"key-%d": 1' % n for n in range(LONG // 10)), InvalidInputError, "key-0"),
        (b'{"time": [%s NaN]}' % (b"1," * LONG), UnreadableBodyError, "no JSON"),
        (b'{"time": [%s' % (b"1," * LONG), UnreadableBodyError, "no JSON"),
        (b'{"time": %s}' % (b"[" * LONG), UnreadableBodyError, "no JSON"),
        (b'{"time": "%s"}' % (b"x" * LONG), InvalidInputError, "list of numbers"),
        (b'{"time": [%s {}]}' % (b"1," * LONG), InvalidInputError, "give numbers"),
        (b'{"time": ["%s"]}' % (b"\\u0031" * LONG), InvalidInputError, "list of numbers"),
        (b'{"time": [%s true]}' % (b"1," * LONG), RequestValidationError, "time"),
        (b'{"time": [%s "noon"]}' % (b'"2026-03-01T09:00:00Z",' * LONG), RequestValidationError, "time"),
    ],
)
def test_what_is_wrong_with_a_long_form_is_said(content: bytes, error: type[Exception], says: str) -> None:
    with pytest.raises(error) as raised:
        read_form(content, PredictForm)
    assert says in str(raised.value)


def test_several_columns_of_a_form() -> None:
    n = PIECE_BYTES
    content = json.dumps({"orders": [0], "time": list(range(n)), "state": [k % 2 for k in range(n)]}).encode()
    form = read_form(content, EvaluateForm)
    assert form.time == [float(k) for k in range(n)]
    assert form.state == [k % 2 for k in range(n)]
