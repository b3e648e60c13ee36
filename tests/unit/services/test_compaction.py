"""Compaction: what it holds while it works."""

import tracemalloc

import numpy as np

from tidemap.history.chunks import CHUNK_CELLS, split
from tidemap.history.measurements import Measurements

CHUNKS, POSTS = 64, 200
MAX_BYTES = 250
"""Per chunk that a post saw something of: three arrays would take twice as much."""


def test_a_log_is_split_into_chunks_without_arrays_for_every_piece() -> None:
    cell = np.arange(CHUNKS, dtype=np.uint32) * CHUNK_CELLS
    parts = [Measurements(np.full(CHUNKS, 60.0 * i), cell, np.ones(CHUNKS, np.uint8)) for i in range(POSTS)]
    tracemalloc.start()
    try:
        pieces = split(parts)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert {chunk: len(found) for chunk, found in pieces.items()} == dict.fromkeys(range(CHUNKS), POSTS)
    assert peak < MAX_BYTES * CHUNKS * POSTS
