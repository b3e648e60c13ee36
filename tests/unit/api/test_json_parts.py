"""JSON in parts: the same text as in one piece."""

from typing import Any

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.api import json_parts
from tidemap.api.json_parts import Mapped, to_json


@given(rows=st.integers(0, 9), columns=st.integers(0, 9), part=st.integers(1, 12))
def test_an_array_of_any_shape_is_written_whole(rows: int, columns: int, part: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_parts, "PART_VALUES", part)
        table = np.arange(rows * columns, dtype=np.float64).reshape(rows, columns) / 3
        content: dict[str, Any] = {"a": table, "b": table.ravel(), "c": Mapped(table, lambda values: values.tolist())}
        written = b"".join(json_parts.json_parts({"plain": [1, None], **content}))
    expected = {"plain": [1, None], "a": table.tolist(), "b": table.ravel().tolist(), "c": table.tolist()}
    assert orjson.loads(written) == expected
    assert written == to_json(expected)
