"""Nav2: maps as map_server loads them, a picture and its YAML, together in a zip."""

import io
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
from tidemap.formats import pictures
from tidemap.formats.npy import UNSEEN
from tidemap.formats.pictures import MAX_WHITE, MapPicture, unreadable, write_pgm, write_png
from tidemap.history.columns import Content
from tidemap.history.history import FREE, OCCUPIED
from tidemap.space.grid import GridGeometry

SHADES = {FREE: 254, OCCUPIED: 0, UNSEEN: 205}
"""As map_saver draws them."""
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""A share of black above the first is occupied, one below the second is free. That of shade 205 is .19608: with a
free_thresh of .25, as Nav2 writes by default, what is unknown would be read as free."""
OCCUPIED_FROM, FREE_TO = 65, 25
"""Percent, as map_saver has it."""
MIN_SPAN = 1e-9
"""Between both thresholds."""
MAX_YAML_BYTES = 65_536
MAX_IMAGE_BYTES = 128 * 2**20
IMAGE, GRADED_IMAGE, YAML = "map.pgm", "map.png", "map.yaml"


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """state (n_cells,) uint8 of a flat grid, in its order of cells: FREE, OCCUPIED or UNSEEN."""

    grid: GridGeometry
    state: NDArray[np.uint8]


def write(plan: FloorPlan) -> bytes:
    """A zip of map.pgm and map.yaml; the same bytes for the same plan. The frame and z of the grid are not in it.

    Raises ValueError for a grid of several layers.
    """
    shades = np.zeros(256, np.uint8)
    shades[list(SHADES)] = list(SHADES.values())
    picture = write_pgm(_drawn(plan.grid, shades[plan.state]))
    described = _description(plan.grid, IMAGE, "trinary", OCCUPIED_THRESH, FREE_THRESH)
    return _zipped(described, picture)


def write_graded(grid: GridGeometry, probability: NDArray[np.float32]) -> bytes:
    """A zip of map.png and map.yaml with the probability of every cell (n_cells,), transparent where it is NaN.

    In the mode `scale` map_server makes a percentage of each shade; what is unknown must be transparent, which a PGM
    cannot say. Raises ValueError for a grid of several layers.
    """
    known = ~np.isnan(probability)
    shade = np.rint(MAX_WHITE * (1 - np.where(known, probability, 0))).astype(np.uint8)
    picture = MapPicture(_drawn(grid, shade), opaque=_drawn(grid, known))
    return _zipped(_description(grid, GRADED_IMAGE, "scale", 1.0, 0.0), write_png(picture))


def _drawn(grid: GridGeometry, values: NDArray[Any]) -> NDArray[Any]:
    """Values (n_cells,) as a picture (ny, nx), whose first line is that of the highest y."""
    nx, ny, layers = grid.shape3
    if layers != 1:
        raise ValueError(f"A map of map_server is flat, but the grid has {layers} layers. Cut one out first.")
    return np.ascontiguousarray(values.reshape(nx, ny).T[::-1])


def _description(grid: GridGeometry, image: str, mode: str, occupied: float, free: float) -> dict[str, Any]:
    return {
        "image": image,
        "mode": mode,
        "resolution": grid.resolution_m,
        "origin": [*grid.origin[:2], 0.0],
        "negate": 0,
        "occupied_thresh": occupied,
        "free_thresh": free,
    }


def _zipped(described: dict[str, Any], picture: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        # An entry made from its name has a time of its own: 1980.
        for name, content in (
            (YAML, yaml.safe_dump(described, sort_keys=False).encode()),
            (described["image"], picture),
        ):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def read(content: Content, frame: str = "map") -> FloorPlan:
    """The plan of a zip with one YAML and the PGM or PNG that it names. Raises UnreadableBodyError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            described = _described(archive)
            name = PurePosixPath(str(described.get("image"))[:1000]).name
            images = [entry for entry in archive.infolist() if PurePosixPath(entry.filename).name == name]
            if len(images) != 1:
                raise unreadable(f"the zip has {len(images)} files {name[:100]!r}, which the YAML names as image")
            image = _entry(archive, images[0], MAX_IMAGE_BYTES)
    except UnreadableBodyError:
        raise
    except Exception as error:  # a damaged zip fails in many ways
        raise unreadable(f"it is no zip, or a damaged one: {str(error)[:200]}") from None
    return _plan(described, image, frame)


def read_pair(described: Content, image: Content, frame: str = "map") -> FloorPlan:
    """The plan of a YAML and the PGM or PNG that belongs to it. Raises UnreadableBodyError."""
    return _plan(_load(described), image, frame)


def _described(archive: zipfile.ZipFile) -> Mapping[str, Any]:
    found = [entry for entry in archive.infolist() if entry.filename.lower().endswith((".yaml", ".yml"))]
    if len(found) != 1:
        raise unreadable(f"the zip has {len(found)} YAML files; send one with its image")
    return _load(_entry(archive, found[0], MAX_YAML_BYTES))


def _entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, most: int) -> bytes:
    """A file of a zip, whatever size it claims."""
    with archive.open(entry) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise unreadable(f"{entry.filename[:100]!r} has more than {most} bytes")
    return content


def _load(text: Content) -> Mapping[str, Any]:
    if len(text) > MAX_YAML_BYTES:
        raise unreadable(f"its YAML has more than {MAX_YAML_BYTES} bytes")
    try:
        described = yaml.safe_load(bytes(text))
    except Exception as error:  # dates that are none and deep nesting are no YAMLError
        raise unreadable(f"its YAML is none: {str(error)[:300]}") from None
    if not isinstance(described, dict):
        raise unreadable("its YAML is no list of keys and values, such as 'resolution: 0.05'")
    return described


def _plan(described: Mapping[str, Any], image: Content, frame: str) -> FloorPlan:
    mode = described.get("mode", "trinary")
    if mode not in ("trinary", "scale"):
        raise unreadable("its mode is neither trinary nor scale")
    resolution = _number(described, "resolution")
    if not resolution > 0:
        raise unreadable(f"its resolution is {resolution}; write the metres of a pixel")
    x, y = _origin(described)
    state = _states(described, pictures.read(image))
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
        raise unreadable(f"its {key} is missing, or no number")
    return number


def _origin(described: Mapping[str, Any]) -> tuple[float, float]:
    origin = described.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise unreadable("its origin is not [x, y, yaw]")
    x, y, yaw = (_finite("origin", each) for each in origin)
    if yaw:
        raise unreadable(f"its origin has a yaw of {yaw}, but cells lie along the axes. Turn the map to a yaw of 0")
    return x, y


def _states(described: Mapping[str, Any], picture: MapPicture) -> NDArray[np.uint8]:
    """States (nx, ny) of a picture (ny, nx)."""
    negate = described.get("negate")
    if negate not in (0, 1):
        raise unreadable("its negate is neither 0 nor 1")
    occupied = _number(described, "occupied_thresh")
    free = _number(described, "free_thresh")
    if not 0 <= free <= occupied <= 1:
        raise unreadable(f"its free_thresh {free} and occupied_thresh {occupied} do not follow between 0 and 1")
    shade = np.arange(picture.white + 1)
    black = (shade if negate else picture.white - shade) / picture.white
    if described.get("mode") == "scale":
        state = states_of_percentages(np.rint(100 * _share(black, free, occupied)))
    else:
        state = np.full(picture.white + 1, UNSEEN, np.uint8)
        state[black < free] = FREE
        state[black > occupied] = OCCUPIED
    found = state[picture.value]
    if picture.opaque is not None and described.get("mode") == "scale":
        found[~picture.opaque] = UNSEEN
    return np.ascontiguousarray(found[::-1].T)


def _share(black: NDArray[np.float64], free: float, occupied: float) -> NDArray[np.float64]:
    """How far shares of black are from `free` to `occupied`, 0 to 1."""
    return np.asarray(np.clip((black - free) / max(occupied - free, MIN_SPAN), 0, 1))


def states_of_percentages(percentage: NDArray[Any]) -> NDArray[np.uint8]:
    """FREE, OCCUPIED or UNSEEN for percentages of being occupied, -1 where nothing is known."""
    state = np.full(percentage.shape, UNSEEN, np.uint8)
    state[(percentage >= 0) & (percentage <= FREE_TO)] = FREE
    state[percentage >= OCCUPIED_FROM] = OCCUPIED
    return state
