"""OctoMap's files: OctoMap reads what is written, what OctoMap wrote is read, and anything else is refused in words."""

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.unit.spectral.real import needed
from tidemap.errors import UnreadableBodyError
from tidemap.formats import octomap
from tidemap.formats.npy import UNSEEN
from tidemap.formats.octomap import CENTRE, OctoTree, log_odds, read, write, write_binary
from tidemap.history.history import FREE, OCCUPIED

STATES = st.sampled_from([FREE, OCCUPIED, UNSEEN])
quick = settings(max_examples=60)


@st.composite
def cells(draw: st.DrawFn) -> tuple[Any, Any, Any]:
    """The lowest key (3,) of a box, its shape, and a state for each cell, many of them alike."""
    low = np.array(draw(st.tuples(*[st.integers(0, 65_500)] * 3)))
    shape = np.array(draw(st.tuples(*[st.integers(1, 9)] * 3)))
    return low, shape, draw(arrays.arrays(np.uint8, int(shape.prod()), elements=STATES, fill=STATES))


def keys(low: Any, shape: Any, chosen: Any) -> Any:
    return np.stack(np.unravel_index(np.flatnonzero(chosen), shape), axis=1) + low


def code_of(key: list[int]) -> int:
    return sum((key[axis] >> bit & 1) << (3 * bit + axis) for bit in range(16) for axis in range(3))


@quick
@given(cells())
def test_what_is_written_is_read_as_it_was(box: tuple[Any, Any, Any]) -> None:
    low, shape, state = box
    known = state != UNSEEN
    tree = read(write_binary(0.25, keys(low, shape, known), state[known] == OCCUPIED))
    assert tree.resolution_m == 0.25
    assert tree.states(low, low + shape).tolist() == state.tolist()
    assert int((tree.edge**3).sum()) == int(known.sum())
    graded = np.where(state == OCCUPIED, 1.5, -0.5).astype(np.float32)[known]
    full = read(write(0.25, keys(low, shape, known), graded))
    assert full.states(low, low + shape).tolist() == state.tolist()
    assert set(full.log_odds.tolist()) <= {1.5, -0.5}


def test_a_code_is_the_path_from_the_root() -> None:
    key = np.array([[0, 0, 0], [65_535, 1, 2], [32_768, 40_000, 7]])
    tree = read(write_binary(1.0, key, np.array([True, True, False])))
    assert sorted(tree.code.tolist()) == sorted(map(code_of, key.tolist()))
    assert sorted(tree.key.tolist()) == sorted(key.tolist())


def test_equal_siblings_are_one_leaf() -> None:
    block = np.indices((4, 4, 4)).reshape(3, -1).T + CENTRE
    tree = read(write_binary(0.1, block, np.ones(64, np.bool_)))
    assert (tree.depth.tolist(), tree.edge.tolist(), tree.key.tolist()) == ([14], [4], [[CENTRE] * 3])
    one_free = read(write_binary(0.1, block, np.arange(64) > 0))
    assert sorted(one_free.edge.tolist()) == [1] * 8 + [2] * 7


def test_octomap_reads_what_is_written_and_writes_the_same_bytes(tmp_path: Path) -> None:
    pyoctomap = pytest.importorskip("pyoctomap", reason="OctoMap has no wheel for this machine")
    key = np.unique(np.random.default_rng(4).integers(CENTRE - 8, CENTRE + 8, (3000, 3)), axis=0)
    p = np.random.default_rng(5).random(len(key)).astype(np.float32)
    centre = (key - CENTRE + 0.5) * 0.5
    file = tmp_path / "map.bt"
    file.write_bytes(write_binary(0.5, key, p > 0.5))
    tree = pyoctomap.OcTree(0.5)
    assert tree.readBinary(str(file))
    assert tree.getLabels(centre).tolist() == (p > 0.5).tolist()
    assert after_head(tree.writeBinary()) == after_head(file.read_bytes())
    full = tmp_path / "map.ot"
    full.write_bytes(write(0.5, key, log_odds(p)))
    graded = tree.read(str(full))
    assert [graded.search(each).getLogOdds() for each in centre[:50]] == log_odds(p)[:50].tolist()
    assert after_head(graded.write()) == after_head(full.read_bytes())


def after_head(content: bytes) -> bytes:
    """The number of nodes, and the tree."""
    return content[content.index(b"size ") :]


def test_the_building_comes_out_as_it_went_in() -> None:
    content = needed("octomap", "geb079.bt").read_bytes()
    tree = read(content)
    assert len(tree.code) == 428_144
    low, stop = tree.bounds()
    state = tree.states(low, stop)
    known = state != UNSEEN
    written = write_binary(tree.resolution_m, keys(low, stop - low, known), state[known] == OCCUPIED)
    assert after_head(written) == after_head(content)
    again = read(written)
    assert np.array_equal(again.code, tree.code)
    assert np.array_equal(again.log_odds, tree.log_odds)


def test_the_boxs_grid_is_octomaps() -> None:
    tree = read(write_binary(0.5, np.array([[CENTRE - 2, CENTRE, CENTRE + 1]]), np.array([True])))
    grid = tree.grid("map", *tree.bounds())
    assert (grid.origin, grid.shape, grid.resolution_m) == ((-1.0, 0.0, 0.5), (1, 1, 1), 0.5)
    with pytest.raises(UnreadableBodyError, match="no leaves"):
        read(write_binary(0.5, np.empty((0, 3), np.int64), np.empty(0, np.bool_))).bounds()


def test_log_odds_of_certainty_are_bounded() -> None:
    p = np.array([0.0, 0.5, 1.0], np.float32)
    assert log_odds(p).tolist() == pytest.approx([-octomap.MAX_LOG_ODDS, 0.0, octomap.MAX_LOG_ODDS])


WRITTEN = write_binary(0.1, np.array([[1, 2, 3], [40_000, 7, 9]]), np.array([True, False]))
FULL = write(0.1, np.array([[1, 2, 3], [40_000, 7, 9]]), np.array([1, -1], np.float32))
DEEP = b"\xff\xff" * 40


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "does not begin"),
        (b"# Octomap OcTree\nid OcTree\nres 1\ndata\n", "does not begin"),
        (WRITTEN[:90], "header that ends"),
        (WRITTEN[:-1], "within a node"),
        (WRITTEN[:-2], "ends too early"),
        (WRITTEN + b"\0\0", "1 follow"),
        (FULL[:-1], "within a node"),
        (FULL[:-5], "ends too early"),
        (FULL + FULL[-5:], "1 follow"),
        (WRITTEN.replace(b"id OcTree", b"id ColorOcTree"), "without colours"),
        (WRITTEN.replace(b"id OcTree", b""), "its id is ''"),
        (WRITTEN.replace(b"res 0.1", b"res nan"), "metres of a cell"),
        (WRITTEN.replace(b"res 0.1", b"res -1"), "metres of a cell"),
        (WRITTEN.replace(b"res 0.1", b"resolution 1"), "metres of a cell"),
        (WRITTEN[: WRITTEN.index(b"data") + 5] + DEEP, "more than 16 levels"),
    ],
)
def test_what_is_no_tree_is_refused_in_words(content: bytes, words: str) -> None:
    with pytest.raises(UnreadableBodyError, match=words):
        read(content)


@quick
@given(st.sampled_from([WRITTEN, FULL]), st.data())
def test_a_damaged_tree_is_read_or_refused_in_words(content: bytes, data: st.DataObject) -> None:
    spoilt = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        spoilt[data.draw(st.integers(0, len(spoilt) - 1))] = data.draw(st.integers(0, 255))
    try:
        tree = read(bytes(spoilt[: data.draw(st.integers(0, len(spoilt)))]))
    except UnreadableBodyError:
        return
    assert isinstance(tree, OctoTree)
    assert ((tree.depth >= 0) & (tree.depth <= 16)).all()


def test_a_tree_with_few_leaves_takes_little_memory() -> None:
    read(WRITTEN)
    content = WRITTEN[: WRITTEN.index(b"data") + 5] + bytes(20_000_000)
    tracemalloc.start()
    with pytest.raises(UnreadableBodyError, match="follow"):
        read(content)
    assert tracemalloc.get_traced_memory()[1] < 200_000_000
    tracemalloc.stop()
