"""Nav2: what is written is read as it was, the real map too, and whatever else comes is refused in words."""

import gzip
import io
import tracemalloc
import zipfile
from collections.abc import Mapping

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.unit.spectral.real import needed
from tidemap.errors import UnreadableBodyError
from tidemap.formats.nav2 import FloorPlan, read, read_pair, write
from tidemap.formats.npy import UNSEEN
from tidemap.history.history import FREE, OCCUPIED
from tidemap.space.grid import GridGeometry

METRES = st.floats(-1e6, 1e6)
quick = settings(max_examples=80)


@st.composite
def plans(draw: st.DrawFn) -> FloorPlan:
    nx, ny = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    origin = (draw(METRES), draw(METRES), 0.0)
    states = st.lists(st.sampled_from([FREE, OCCUPIED, UNSEEN]), min_size=nx * ny, max_size=nx * ny)
    grid = GridGeometry("map", origin, draw(st.floats(1e-6, 1e3)), (nx, ny))
    return FloorPlan(grid, np.array(draw(states), np.uint8))


def files(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(parts: Mapping[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return packed.getvalue()


def pgm(row: list[int], white: int = 255) -> bytes:
    """A picture of one line."""
    return b"P5\n%d 1\n%d\n" % (len(row), white) + bytes(row)


def described(**changes: object) -> bytes:
    """The YAML of a map; None leaves a line out."""
    entries = {
        "image": "map.pgm",
        "resolution": 0.5,
        "origin": [1.0, 2.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.25,
    } | changes
    return yaml.safe_dump({key: value for key, value in entries.items() if value is not None}).encode()


@quick
@given(plans())
def test_a_written_map_is_read_as_it_was(plan: FloorPlan) -> None:
    content = write(plan)
    found = read(content)
    assert found.grid == plan.grid
    assert found.state.dtype == np.uint8
    assert found.state.tolist() == plan.state.tolist()
    assert write(found) == content


@quick
@given(plans())
def test_another_program_sees_the_picture_with_the_highest_y_on_top(plan: FloorPlan) -> None:
    parts = files(write(plan))
    picture = np.asarray(Image.open(io.BytesIO(parts["map.pgm"])))
    entries = yaml.safe_load(parts["map.yaml"])
    assert entries["image"] == "map.pgm"
    assert (entries["resolution"], entries["origin"]) == (plan.grid.resolution_m, [*plan.grid.origin[:2], 0.0])
    nx, ny = plan.grid.shape
    assert picture.shape == (ny, nx)
    shade = {FREE: 254, OCCUPIED: 0, UNSEEN: 205}
    for cell, (i, j, _) in enumerate(plan.grid.index(np.arange(plan.grid.n_cells)).tolist()):
        assert picture[ny - 1 - j, i] == shade[int(plan.state[cell])]


def test_a_grid_of_one_layer_is_flat_and_one_of_two_is_refused() -> None:
    flat = GridGeometry("map", (0.0, 0.0, 3.0), 0.1, (2, 1, 1))
    assert read(write(FloorPlan(flat, np.array([0, 1], np.uint8)))).state.tolist() == [0, 1]
    with pytest.raises(ValueError, match="2 layers"):
        write(FloorPlan(GridGeometry("map", (0.0, 0.0, 0.0), 0.1, (2, 1, 2)), np.zeros(4, np.uint8)))


def test_the_real_map_comes_out_as_it_went_in() -> None:
    image = gzip.decompress(needed("nav2_map", "y4_aaf-cropped.pgm.gz").read_bytes())
    text = needed("nav2_map", "y4_aaf-cropped.yaml").read_bytes()
    plan = read_pair(text, image)
    assert plan.grid.shape == (1101, 2853)
    assert [int((plan.state == state).sum()) for state in (FREE, OCCUPIED, UNSEEN)] == [652_623, 47_832, 2_440_698]
    parts = files(write(plan))
    one, other = (np.asarray(Image.open(io.BytesIO(each))) for each in (parts["map.pgm"], image))
    assert np.array_equal(one, other)
    before, after = yaml.safe_load(text), yaml.safe_load(parts["map.yaml"])
    assert before | {"image": "map.pgm", "mode": "trinary"} == after
    again = read(zipped({"maps/home.yaml": text, "maps/y4_aaf-cropped.pgm": image}), frame="home")
    assert again.grid.frame == "home"
    assert np.array_equal(again.state, plan.state)


def states(shades: list[int], white: int = 255, **changes: object) -> list[int]:
    return list(read_pair(described(**changes), pgm(shades, white)).state.tolist())


def test_shades_become_states_as_in_map_server() -> None:
    """With 255 as white a share of black above .65 is one of at most 89, one below .25 is one of at least 192."""
    assert states([0, 89, 90, 191, 192, 255]) == [1, 1, UNSEEN, UNSEEN, 0, 0]
    # Between the thresholds of .65 and .25 these are 100, 65, 64, 25, 26 and 0 percent.
    assert states([0, 125, 126, 166, 165, 255], mode="scale") == [1, 1, UNSEEN, 0, UNSEEN, 0]
    assert states([255, 0], mode="scale", free_thresh=0.5, occupied_thresh=0.5) == [0, 1]
    assert states([255, 166, 165, 64, 63, 0], negate=1) == [1, 1, UNSEEN, UNSEEN, 0, 0]
    assert states([255, 0], negate=True) == [1, 0]
    assert states([205, 205], free_thresh=0.196) == [UNSEEN, UNSEEN]
    assert states([205, 205], free_thresh=0.25) == [0, 0]
    assert states([0, 1, 2, 3, 4], 4, occupied_thresh=0.5, free_thresh=0.5) == [1, 1, UNSEEN, 0, 0]


def test_a_header_may_have_comments_and_numbers_may_be_texts() -> None:
    image = b"P5 # made by\n# GIMP 2\n 2\t1 # size\n255\n" + bytes([0, 255])
    plan = read_pair(described().replace(b"0.5", b"5e-1"), image)
    assert plan.grid.resolution_m == 0.5
    assert plan.state.tolist() == [1, 0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"resolution": None}, "resolution is missing"),
        ({"resolution": 0.0}, "metres of a pixel"),
        ({"resolution": float("nan")}, "no number"),
        ({"resolution": [[1]]}, "no number"),
        ({"resolution": True}, "no number"),
        ({"origin": None}, "x, y, yaw"),
        ({"origin": [0.0, 0.0]}, "x, y, yaw"),
        ({"origin": [0.0, "a", 0.0]}, "no number"),
        ({"origin": [0.0, 0.0, 0.1]}, "yaw of 0.1"),
        ({"negate": 2}, "negate"),
        ({"negate": None}, "negate"),
        ({"free_thresh": None}, "free_thresh is missing"),
        ({"occupied_thresh": None}, "occupied_thresh is missing"),
        ({"comment": "x" * 70_000}, "more than"),
        ({"mode": "raw"}, "neither trinary nor scale"),
        ({"mode": [1]}, "neither trinary nor scale"),
        ({"free_thresh": 0.7}, "do not follow"),
        ({"occupied_thresh": 1.5}, "do not follow"),
        ({"occupied_thresh": "much"}, "no number"),
    ],
)
def test_a_wrong_yaml_is_refused_in_words(changes: dict[str, object], words: str) -> None:
    with pytest.raises(UnreadableBodyError, match=words):
        read_pair(described(**changes), pgm([0]))


@pytest.mark.parametrize(
    "text", [b"", b"[]", b"a: [", b"resolution: 2001-99-99", b"[" * 60_000, b"a: !!python/name:os.system", b"\xff"]
)
def test_what_is_no_yaml_is_refused_in_words(text: bytes) -> None:
    with pytest.raises(UnreadableBodyError, match=r"YAML"):
        read_pair(text, pgm([0]))


def test_what_refers_to_itself_again_and_again_takes_no_memory() -> None:
    laughs = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 60))
    for line in ("resolution: *a59", "mode: *a59\nresolution: 1", "resolution: 1\norigin: *a59"):
        with pytest.raises(UnreadableBodyError) as refused:
            read_pair(f"{laughs}{line}\n".encode(), pgm([0]))
        assert len(str(refused.value)) < 500


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (b"", "P5"),
        (b"P2\n1 1\n255\n0\n", "P5"),
        (b"\x89PNG\r\n", "P5"),
        (b"\x89PNG\r\n\x1a\n", "PNG is damaged"),
        (b"P5\n", "width"),
        (b"P5\n0 1\n255\n", "width"),
        (b"P5\n1 99999\n255\n", "height"),
        (b"P5\n1 x\n255\n", "height"),
        (b"P5\n1 1\n65535\n\0\0", "white"),
        (b"P5\n1 1\n255", "white"),
        (b"P5\n2 2\n255\n\0\0\0", "3 bytes follow"),
        (b"P5\n2 1\n255\n\0\0\0", "3 bytes follow"),
        (b"P5\n1 1\n100\n\xff", "above 100"),
        (b"P5 #" + b"#" * 10_000, "width"),
    ],
)
def test_a_wrong_image_is_refused_in_words(image: bytes, words: str) -> None:
    with pytest.raises(UnreadableBodyError, match=words):
        read_pair(described(), image)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({}, "0 YAML files"),
        ({"a.yaml": described(), "b.yml": described()}, "2 YAML files"),
        ({"a.yaml": described()}, "0 files 'map.pgm'"),
        ({"a.yaml": described(image=None)}, "0 files 'None'"),
        ({"a.yaml": described(), "a/map.pgm": b"", "b/map.pgm": b""}, "2 files 'map.pgm'"),
        ({"a.yaml": b" " * 100_000}, "more than"),
    ],
)
def test_a_wrong_zip_is_refused_in_words(parts: dict[str, bytes], words: str) -> None:
    with pytest.raises(UnreadableBodyError, match=words):
        read(zipped(parts))


def test_a_file_that_unpacks_to_very_much_is_read_no_further_than_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tidemap.formats.nav2.MAX_IMAGE_BYTES", 100_000)
    content = zipped({"map.yaml": described(), "map.pgm": bytes(50_000_000)})
    tracemalloc.start()
    with pytest.raises(UnreadableBodyError, match="more than 100000 bytes"):
        read(content)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


WRITTEN = write(FloorPlan(GridGeometry("map", (0.0, 1.0, 0.0), 0.05, (5, 4)), np.arange(20, dtype=np.uint8) % 2))


def assert_plan_or_words(content: bytes) -> None:
    """Any other error, and any warning, fails."""
    try:
        plan = read(content)
    except UnreadableBodyError as refused:
        words = str(refused)
        assert 20 < len(words) < 1000
        return
    assert plan.state.shape == (plan.grid.n_cells,)
    assert set(plan.state.tolist()) <= {FREE, OCCUPIED, UNSEEN}


def test_a_zip_that_breaks_off_is_refused() -> None:
    for end in range(len(WRITTEN)):
        with pytest.raises(UnreadableBodyError):
            read(WRITTEN[:end])


@settings(max_examples=300)
@given(st.data())
def test_damaged_zips_give_a_plan_or_words(data: st.DataObject) -> None:
    damaged = bytearray(WRITTEN)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        damaged[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    assert_plan_or_words(bytes(damaged))


@settings(max_examples=300)
@given(st.data())
def test_damaged_files_give_a_plan_or_words(data: st.DataObject) -> None:
    parts = files(WRITTEN)
    for name in parts:
        damaged = bytearray(parts[name])
        for _ in range(data.draw(st.integers(0, 3))):
            at = data.draw(st.integers(0, len(damaged) - 1))
            damaged[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
        parts[name] = bytes(damaged)
    assert_plan_or_words(zipped(parts))
