"""JSON in parts: the same text as in one piece."""

from typing import Any

import numpy as np
import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tidemap.formats.json_columns import parts
from tidemap.formats.json_columns.parts import to_json
from tidemap.formats.table import Nullable


@given(rows=st.integers(0, 9), columns=st.integers(0, 9), part=st.integers(1, 12))
def test_an_array_of_any_shape_is_written_whole(rows: int, columns: int, part: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "PART_VALUES", part)
        table = np.arange(rows * columns, dtype=np.float64).reshape(rows, columns) / 3
        content: dict[str, Any] = {"a": table, "b": table.ravel(), "c": Nullable(table, table > 2)}
        written = b"".join(parts.write({"plain": [1, None], **content}))
    expected = {
        "plain": [1, None],
        "a": table.tolist(),
        "b": table.ravel().tolist(),
        "c": [[None if x > 2 else x for x in row] for row in table.tolist()],
    }
    assert orjson.loads(written) == expected
    assert written == to_json(expected)
