"""Nav2: maps as map_server loads them, a PGM and its YAML, together in a zip."""

import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from tidemap.errors import UnreadableBodyError
from tidemap.formats.npy import UNSEEN
from tidemap.history.columns import Content
from tidemap.space.grid import GridGeometry

FREE, OCCUPIED = 0, 1
SHADES = {FREE: 254, OCCUPIED: 0, UNSEEN: 205}
"""As map_saver draws them."""
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""A share of black above the first is occupied, one below the second is free. That of shade 205 is .19608: with a
free_thresh of .25, as Nav2 writes by default, what is unknown would be read as free."""
MAX_YAML_BYTES = 65_536
MAX_IMAGE_BYTES = 128 * 2**20
MAX_HEAD_BYTES = 4096
"""Bytes of the longest header of a PGM."""
MAX_SIDE = 65_536
"""Cells along an axis."""
MAX_WHITE = 255
"""The highest value of one byte."""
NUMBER = re.compile(rb"(?:\s|#[^\n]*\n)+([0-9]{1,9})(?=\s)")
"""Of a PGM's header; comments may stand in front of it."""
IMAGE, YAML = "map.pgm", "map.yaml"


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """state (n_cells,) uint8 of a flat grid, in its order of cells: FREE, OCCUPIED or UNSEEN."""

    grid: GridGeometry
    state: NDArray[np.uint8]


def write(plan: FloorPlan) -> bytes:
    """A zip of map.pgm and map.yaml; the same bytes for the same plan. The frame and z of the grid are not in it.

    Raises ValueError for a grid of several layers.
    """
    nx, ny, layers = plan.grid.shape3
    if layers != 1:
        raise ValueError(f"A map of map_server is flat, but the grid has {layers} layers. Cut one out first.")
    shades = np.zeros(256, np.uint8)
    shades[list(SHADES)] = list(SHADES.values())
    # The first line of the picture is that of the highest y.
    picture = shades[plan.state.reshape(nx, ny).T[::-1]]
    described = {
        "image": IMAGE,
        "mode": "trinary",
        "resolution": plan.grid.resolution_m,
        "origin": [*plan.grid.origin[:2], 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        # An entry made from its name has a time of its own: 1980.
        for name, content in (
            (YAML, yaml.safe_dump(described, sort_keys=False).encode()),
            (IMAGE, b"P5\n%d %d\n255\n" % (nx, ny) + picture.tobytes()),
        ):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def read(content: Content, frame: str = "map") -> FloorPlan:
    """The plan of a zip with one YAML and the PGM that it names. Raises UnreadableBodyError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            described = _described(archive)
            name = PurePosixPath(str(described.get("image"))[:1000]).name
            images = [entry for entry in archive.infolist() if PurePosixPath(entry.filename).name == name]
            if len(images) != 1:
                raise _unreadable(f"the zip has {len(images)} files {name[:100]!r}, which the YAML names as image")
            image = _entry(archive, images[0], MAX_IMAGE_BYTES)
    except UnreadableBodyError:
        raise
    except Exception as error:  # a damaged zip fails in many ways
        raise _unreadable(f"it is no zip, or a damaged one: {str(error)[:200]}") from None
    return _plan(described, image, frame)


def read_pair(described: Content, image: Content, frame: str = "map") -> FloorPlan:
    """The plan of a YAML and the PGM that belongs to it. Raises UnreadableBodyError."""
    return _plan(_load(described), image, frame)


def _unreadable(why: str) -> UnreadableBodyError:
    return UnreadableBodyError(f"This map cannot be read: {why}.")


def _described(archive: zipfile.ZipFile) -> Mapping[str, Any]:
    found = [entry for entry in archive.infolist() if entry.filename.lower().endswith((".yaml", ".yml"))]
    if len(found) != 1:
        raise _unreadable(f"the zip has {len(found)} YAML files; send one with its image")
    return _load(_entry(archive, found[0], MAX_YAML_BYTES))


def _entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, most: int) -> bytes:
    """A file of a zip, whatever size it claims."""
    with archive.open(entry) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise _unreadable(f"{entry.filename[:100]!r} has more than {most} bytes")
    return content


def _load(text: Content) -> Mapping[str, Any]:
    if len(text) > MAX_YAML_BYTES:
        raise _unreadable(f"its YAML has more than {MAX_YAML_BYTES} bytes")
    try:
        described = yaml.safe_load(bytes(text))
    except Exception as error:  # dates that are none and deep nesting are no YAMLError
        raise _unreadable(f"its YAML is none: {str(error)[:300]}") from None
    if not isinstance(described, dict):
        raise _unreadable("its YAML is no list of keys and values, such as 'resolution: 0.05'")
    return described


def _plan(described: Mapping[str, Any], image: Content, frame: str) -> FloorPlan:
    mode = described.get("mode", "trinary")
    if mode not in ("trinary", "scale"):
        raise _unreadable("its mode is neither trinary nor scale")
    resolution = _number(described, "resolution")
    if not resolution > 0:
        raise _unreadable(f"its resolution is {resolution}; write the metres of a pixel")
    x, y = _origin(described)
    state = _states(described, *_picture(image))
    return FloorPlan(GridGeometry(frame, (x, y, 0.0), resolution, state.shape), state.reshape(-1))


def _number(described: Mapping[str, Any], key: str) -> float:
    return _finite(key, described.get(key))


def _finite(key: str, value: object) -> float:
    """YAML 1.1 takes 5e-2 for a text, map_server does not."""
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else None
    except (ValueError, OverflowError):
        number = None
    if number is None or not isfinite(number):
        raise _unreadable(f"its {key} is missing, or no number")
    return number


def _origin(described: Mapping[str, Any]) -> tuple[float, float]:
    origin = described.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise _unreadable("its origin is not [x, y, yaw]")
    x, y, yaw = (_finite("origin", each) for each in origin)
    if yaw:
        raise _unreadable(f"its origin has a yaw of {yaw}, but cells lie along the axes. Turn the map to a yaw of 0")
    return x, y


def _states(described: Mapping[str, Any], picture: NDArray[np.uint8], white: int) -> NDArray[np.uint8]:
    """States (nx, ny) of a picture (ny, nx) with values from black, 0, to `white`."""
    negate = described.get("negate")
    if negate not in (0, 1):
        raise _unreadable("its negate is neither 0 nor 1")
    occupied = _number(described, "occupied_thresh")
    free = _number(described, "free_thresh")
    if not 0 <= free <= occupied <= 1:
        raise _unreadable(f"its free_thresh {free} and occupied_thresh {occupied} do not follow between 0 and 1")
    shade = np.arange(white + 1)
    black = (shade if negate else white - shade) / white
    state = np.full(white + 1, UNSEEN, np.uint8)
    state[black < free] = FREE
    state[black > occupied] = OCCUPIED
    return np.ascontiguousarray(state[picture[::-1].T])


def _picture(image: Content) -> tuple[NDArray[np.uint8], int]:
    """Values (height, width) of a binary PGM, and that of white."""
    head, at, numbers = bytes(image[:MAX_HEAD_BYTES]), 2, []
    if head[:2] != b"P5":
        raise _unreadable("its image is no binary PGM, which begins with P5. Save it as such")
    for what, most in (("width", MAX_SIDE), ("height", MAX_SIDE), ("white", MAX_WHITE)):
        found = NUMBER.match(head, at)
        if found is None or not 1 <= int(found[1]) <= most:
            raise _unreadable(f"the {what} of its PGM is no whole number from 1 to {most}")
        numbers.append(int(found[1]))
        at = found.end()
    width, height, white = numbers
    start = at + 1  # one space or end of line
    if len(image) - start != width * height:
        raise _unreadable(f"its PGM declares {width} x {height} pixels, but {max(len(image) - start, 0)} bytes follow")
    picture = np.frombuffer(image, np.uint8, width * height, start).reshape(height, width)
    if picture.max() > white:
        raise _unreadable(f"its PGM has values above {white}, which it declares as white")
    return picture, white
