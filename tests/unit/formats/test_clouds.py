"""PCD and PLY: what was written is read, and whatever else comes is refused in words."""

import base64
import struct
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from tests.unit.formats import clouds
from tests.unit.spectral.real import needed
from tidemap.errors import UnreadableBodyError
from tidemap.formats import pcd, ply
from tidemap.formats.cloud import MAX_POINTS, Points
from tidemap.formats.pcd import MAX_GROWTH

Read = Callable[[bytes], Points]
KINDS = ("<f4", "<f8")
PCD_DATA = ("ascii", "binary", "binary_compressed")
PLY_KINDS = ("ascii", "binary_little_endian", "binary_big_endian")
CLOUDS = arrays.arrays(
    np.float32,
    st.tuples(st.integers(0, 40), st.just(3)),
    elements=st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, 2.5])),
)
quick = settings(max_examples=60)


def some(n: int = 7, kind: str = "<f4") -> clouds.Rows:
    return clouds.rows(np.random.default_rng(1).normal(size=(n, 3)), kind)


FILES: list[tuple[Read, bytes]] = [
    *((pcd.read, clouds.pcd(some(), data)) for data in PCD_DATA),
    *((ply.read, clouds.ply(some(), kind)) for kind in PLY_KINDS),
]
NAMES = [*(f"pcd-{data}" for data in PCD_DATA), *(f"ply-{kind}" for kind in PLY_KINDS)]
every_file = pytest.mark.parametrize(("read", "content"), FILES, ids=NAMES)


def assert_same(found: Points, points: NDArray[np.floating]) -> None:
    assert found.dtype == np.float32
    assert found.shape == points.shape
    np.testing.assert_array_equal(found, points)


@quick
@given(CLOUDS, st.sampled_from(PCD_DATA), st.sampled_from(KINDS))
def test_a_written_pcd_is_read(points: NDArray[np.float32], data: str, kind: str) -> None:
    assert_same(pcd.read(clouds.pcd(clouds.rows(points, kind), data)), points)


@quick
@given(CLOUDS, st.sampled_from(PLY_KINDS), st.sampled_from(KINDS))
def test_a_written_ply_is_read(points: NDArray[np.float32], kind_of_file: str, kind: str) -> None:
    assert_same(ply.read(clouds.ply(clouds.rows(points, kind), kind_of_file)), points)


def test_what_single_precision_cannot_hold_is_infinite() -> None:
    table = clouds.rows(np.array([[1e300, -1e300, 1.0]]), "<f8")
    for data in PCD_DATA:
        assert pcd.read(clouds.pcd(table, data)).tolist() == [[np.inf, -np.inf, 1.0]]


def test_points_packed_by_the_library_itself_are_read() -> None:
    """These bytes are liblzf's, of x = i // 100, y = i % 3 / 2 and z = 0."""
    i = np.arange(300)
    points = np.stack([i // 100, i % 3 * 0.5, np.zeros(300)], axis=1).astype("<f4")
    head = clouds.pcd_head(np.zeros(300, np.dtype([(name, "<f4") for name in "xyz"])), "binary_compressed")
    packed = base64.b85decode("0RRBt{{Y~B00DqM;Qs^ReFp&mK;Zua;eH1|0HPaU0O0=%;r|EW{|Dj!2jP1M;Qs*N{{Z0s0O0=s;C=uB000")
    assert_same(pcd.read(head + struct.pack("<II", len(packed), 3600) + packed), points)


@quick
@given(st.binary(max_size=2000), st.integers(1, 40))
def test_packed_bytes_are_unpacked(content: bytes, times: int) -> None:
    plain = content * times
    table = np.zeros(len(plain) // 12, np.dtype([(name, "<f4") for name in "xyz"]))
    for at, name in enumerate("xyz"):
        table[name] = np.frombuffer(plain, "<f4", len(table), at * 4 * len(table))
    assert pcd.read(clouds.pcd(table, "binary_compressed")).tobytes() == points_bytes(table)


def points_bytes(table: clouds.Rows) -> bytes:
    return np.stack([table[name] for name in "xyz"], axis=1).tobytes()


def test_other_elements_of_a_ply_are_left_out() -> None:
    table = some(3)
    points = np.stack([table[name] for name in "xyz"], axis=1)
    camera = "element camera 2\nproperty uchar a\nproperty double b"
    faces = "element face 1\nproperty list uchar int vertex_indices"
    packed = clouds.ply_head(table, "binary_little_endian", camera, faces)
    assert_same(ply.read(packed + bytes(18) + table.tobytes() + b"\3" + bytes(12)), points)
    lines = clouds.ply_head(table, "ascii", camera, faces)
    assert_same(ply.read(lines + b"1 2.5\n3 4.5\n" + clouds.text(table) + b"3 0 1 2\n"), points)


def test_lines_may_end_as_on_windows() -> None:
    table = some(3)
    for read, content in ((pcd.read, clouds.pcd(table, "ascii")), (ply.read, clouds.ply(table, "ascii"))):
        np.testing.assert_array_equal(read(content.replace(b"\n", b"\r\n")), read(content))


def test_fields_of_several_values_and_padding_are_skipped() -> None:
    kinds = [("a", "<f4", 3), ("x", "<f8"), ("b", "u1", 5), ("y", "<f8"), ("z", "<f8"), ("c", "<i8")]
    table = np.zeros(4, np.dtype(kinds))
    for at, name in enumerate("xyz"):
        table[name] = np.arange(4) + at / 4
    head = clouds.pcd_head(
        table, "binary", SIZE="4 8 1 8 8 8", TYPE="F F U F F I", COUNT="3 1 5 1 1 1", FIELDS="_ x _ y z c"
    )
    assert pcd.read(head + table.tobytes())[3].tolist() == [3.0, 3.25, 3.5]


@pytest.mark.parametrize("name", ["source", "target"])
def test_a_real_cloud_is_what_another_reader_reads(name: str) -> None:
    path = needed("lidar_pair", f"{name}.ply")
    found = ply.read(path.read_bytes())
    assert len(found) > 60_000
    other = trimesh.load(path)
    assert isinstance(other, trimesh.PointCloud)
    np.testing.assert_array_equal(found, other.vertices)
    table = clouds.rows(found[:2000])
    for data in PCD_DATA:
        np.testing.assert_array_equal(pcd.read(clouds.pcd(table, data)), found[:2000])


@every_file
def test_a_file_that_breaks_off_is_refused(read: Read, content: bytes) -> None:
    """Of text the last line may lose digits unnoticed, but no number may be missing."""
    last = content.rstrip(b"\n").rfind(b" ") if b"ascii" in content else len(content) - 1
    for end in range(last + 1):
        with pytest.raises(UnreadableBodyError):
            read(content[:end])


@every_file
def test_a_file_with_more_than_it_declares_is_refused(read: Read, content: bytes) -> None:
    with pytest.raises(UnreadableBodyError):
        read(content + b"1 2 3 4\n")


@settings(max_examples=400)
@given(st.data())
def test_damaged_files_give_points_or_words(data: st.DataObject) -> None:
    read, content = data.draw(st.sampled_from(FILES))
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        part = data.draw(
            st.one_of(st.binary(max_size=4), st.sampled_from([b"9" * 9, b" ", b"\n", b"-", b"nan", b"1e999"]))
        )
        damaged[at : at + data.draw(st.integers(0, 6))] = part
    assert_points_or_words(read, bytes(damaged))


@quick
@given(st.sampled_from([pcd.read, ply.read]), st.binary(max_size=300))
def test_any_bytes_give_points_or_words(read: Read, content: bytes) -> None:
    assert_points_or_words(read, content)


@settings(max_examples=300)
@given(st.binary(max_size=120), st.integers(0, 40))
def test_any_packed_bytes_give_points_or_words(packed: bytes, n: int) -> None:
    table = np.zeros(n, np.dtype([(name, "<f4") for name in "xyz"]))
    content = clouds.pcd_head(table, "binary_compressed") + struct.pack("<II", len(packed), n * 12) + packed
    assert_points_or_words(pcd.read, content)


def assert_points_or_words(read: Read, content: bytes) -> None:
    """Any other error, and any warning, fails."""
    try:
        found = read(content)
    except UnreadableBodyError as refused:
        words = str(refused)
        assert 20 < len(words) < 1000
        return
    assert found.dtype == np.float32
    assert found.shape == (len(found), 3)


@pytest.mark.parametrize("n", [MAX_POINTS, 10**12, 10**18, 10**30])
def test_many_declared_points_take_no_memory(n: int) -> None:
    table = some(3)
    fields = {"WIDTH": str(n), "POINTS": str(n)}
    files = [(pcd.read, clouds.pcd_head(table, data, **fields) + bytes(200)) for data in PCD_DATA]
    promise = struct.pack("<II", 192, min(n * 14, 2**32 - 1)) + bytes(192)
    files.append((pcd.read, clouds.pcd_head(table, "binary_compressed", **fields) + promise))
    files += [
        (ply.read, clouds.ply(table, kind).replace(b"vertex 3", b"vertex %d" % n) + bytes(200)) for kind in PLY_KINDS
    ]
    before = f"element other {n}\nproperty float a"
    files += [(ply.read, clouds.ply_head(table, kind, before) + table.tobytes()) for kind in PLY_KINDS]
    tracemalloc.start()
    for read, content in files:
        with pytest.raises(UnreadableBodyError):
            read(content)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_compressed_points_are_unpacked_once_and_said_to_be_before() -> None:
    n = 30_000
    content = clouds.pcd(np.zeros(n, np.dtype([(name, "<f4") for name in "xyz"])), "binary_compressed")
    assert pcd.unpacked_bytes(content) == n * 12 > 20 * len(content)
    pcd.read(content)
    tracemalloc.start()
    assert pcd.read(content).shape == (n, 3)
    assert tracemalloc.get_traced_memory()[1] < 2.3 * n * 12, "the bytes, and the points"
    tracemalloc.stop()


def test_only_compressed_points_take_memory_beside_their_file() -> None:
    table = some(3)
    assert [pcd.unpacked_bytes(clouds.pcd(table, data)) for data in PCD_DATA] == [0, 0, 3 * table.dtype.itemsize]
    with pytest.raises(UnreadableBodyError, match="bytes, but"):
        pcd.unpacked_bytes(clouds.pcd(table, "binary_compressed")[:-1])


def test_more_than_packed_bytes_can_hold_is_refused() -> None:
    n = MAX_GROWTH * 100
    table = np.zeros(n, np.dtype([(name, "<f4") for name in "xyz"]))
    content = clouds.pcd_head(table, "binary_compressed") + struct.pack("<II", 100, n * 12) + bytes(100)
    with pytest.raises(UnreadableBodyError, match="cannot be"):
        pcd.read(content)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"FIELDS": ""}, "no line FIELDS"),
        ({"FIELDS": "x y i q"}, "0 fields z"),
        ({"FIELDS": "x y z z"}, "2 fields z"),
        ({"FIELDS": "x y z"}, "not of one length"),
        ({"COUNT": "1 1 1 2"}, "z"),
        ({"COUNT": "1 1 99999 1"}, "at most"),
        ({"COUNT": "1 1 -1 1"}, "whole number"),
        ({"SIZE": "4 4 3 4"}, "no type"),
        ({"TYPE": "F F U I"}, "int32"),
        ({"SIZE": "4 4 2 2", "TYPE": "F F U F"}, "no type"),
        ({"WIDTH": "3.5"}, "whole number"),
        ({"WIDTH": ""}, "no line WIDTH"),
        ({"HEIGHT": "2"}, "WIDTH times HEIGHT"),
        ({"WIDTH": "3000", "HEIGHT": "3000", "POINTS": ""}, "at most"),
        ({"DATA": "base64"}, "binary_compressed"),
        ({"FIELDS": " ".join(["a"] * 2000)}, "2000 fields"),
    ],
)
def test_a_wrong_pcd_header_is_refused_in_words(changes: dict[str, str], words: str) -> None:
    table = some(3)
    with pytest.raises(UnreadableBodyError, match=words):
        pcd.read(clouds.pcd_head(table, "binary", **changes) + table.tobytes())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ply\n", "plys\n", "begin with"),
        ("binary_little_endian 1.0", "binary_little_endian 1.1", "1.1; write one of"),
        ("binary_little_endian", "binary", "binary 1.0; write one of"),
        ("format binary_little_endian 1.0\n", "", "not stated"),
        ("float x", "int x", "int32"),
        ("float x", "half x", "known type"),
        ("float x", "float", "known type"),
        ("float x", "list uchar float x", "lists"),
        ("property float x\n", "", "0 fields x"),
        ("vertex 3", "vertex three", "whole number"),
        ("vertex 3", "vertex", "element NAME NUMBER"),
        ("vertex 3", "edge 3", "0 elements 'vertex'"),
        ("element vertex 3\n", "", "before the first element"),
        ("comment", "remark", "begins with 'remark'"),
        ("end_header", "property", "known type|no line"),
        ("element vertex", "element face 1\nproperty list uchar int a\nelement vertex", "lists before"),
        ("end_header", "property uchar a\n" * 2000 + "end_header", "at most"),
    ],
)
def test_a_wrong_ply_header_is_refused_in_words(old: str, new: str, words: str) -> None:
    content = clouds.ply(some(3), "binary_little_endian")
    with pytest.raises(UnreadableBodyError, match=words):
        ply.read(content.replace(old.encode(), new.encode(), 1))


@pytest.mark.parametrize("line", [b"1 2 3 x\n", b"1 2 3\n", b"1 2 3 \xff\n", b"a b c d e f\n", b"1,2,3,4\n"])
def test_wrong_lines_are_refused_in_words(line: bytes) -> None:
    for head, read in ((clouds.pcd_head(some(1), "ascii"), pcd.read), (clouds.ply_head(some(1), "ascii"), ply.read)):
        with pytest.raises(UnreadableBodyError, match=r"no points|too short"):
            read(head + line)


@pytest.mark.parametrize(
    ("packed", "unpacked", "words"),
    [
        (b"\x0b" + bytes(12), 12, None),
        (b"\x0b" + bytes(12), 24, "compressed points 24"),
        (b"\x0a" + bytes(11), 12, "damaged"),
        (b"\x0c" + bytes(13), 12, "damaged"),
        (b"\x0b" + bytes(11), 12, "damaged"),
        (b"\x00\x00\xe0\x02\x00", 12, None),
        (b"\x00\x00\xe0\x02\x01", 12, "damaged"),
        (b"\x20\x00" + b"\x08" + bytes(9), 12, "damaged"),
        (b"\x00\x00\xe0\x03\x00", 12, "damaged"),
        (b"\x0a" + bytes(11) + b"\xe0", 12, "damaged"),
        (b"\x0a" + bytes(11) + b"\x20", 12, "damaged"),
    ],
)
def test_packed_bytes_that_are_wrong_are_refused(packed: bytes, unpacked: int, words: str | None) -> None:
    """One point: literal bytes, references forward and back, and sizes that are not theirs."""
    head = clouds.pcd_head(np.zeros(1, np.dtype([(name, "<f4") for name in "xyz"])), "binary_compressed")
    content = head + struct.pack("<II", len(packed), unpacked) + packed
    if words is None:
        assert pcd.read(content).tolist() == [[0.0, 0.0, 0.0]]
        return
    with pytest.raises(UnreadableBodyError, match=words):
        pcd.read(content)
