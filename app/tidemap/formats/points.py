"""Points of scans by media type: files and streams to arrays (n, 3), or (n, 2) of a planar sensor."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError, UnsupportedMediaTypeError
from tidemap.formats import arrow, npy, pcd, ply
from tidemap.formats.cloud import MAX_POINTS
from tidemap.history.columns import Content
from tidemap.media_types import ARROW, NPY, PCD, PLY

AXES = ("x", "y", "z")
Read = Callable[[Content], NDArray[np.floating]]


def read(content: Content, media_type: str) -> NDArray[np.floating]:
    """Points (n, 2 or 3) of a media type. Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError."""
    reader = READERS.get(media_type)
    if reader is None:
        raise UnsupportedMediaTypeError(
            f"The part 'points' has the Content-Type {media_type!r}; send one of {', '.join(READERS)}."
        )
    return reader(content)


def read_numbers(content: Content, field: str) -> NDArray[np.floating]:
    """Floating-point numbers (n,) of an npy file. Raises UnreadableBodyError, InvalidInputError."""
    array = _floats(content, field)
    if array.ndim != 1:
        raise InvalidInputError.at(field, f"its shape is {array.shape}; send one number a ray: shape (n,)")
    return array


def _of_npy(content: Content) -> NDArray[np.floating]:
    array = _floats(content, "points")
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidInputError.at("points", f"its shape is {array.shape}; send (n, 3), or (n, 2) of a planar sensor")
    return array


def _floats(content: Content, field: str) -> NDArray[np.floating]:
    array = npy.read_array(content)
    if array.dtype.kind != "f" or array.dtype.itemsize not in (4, 8):
        raise InvalidInputError.at(field, f"its type is {array.dtype}; send float32 or float64")
    if len(array) > MAX_POINTS:
        raise InvalidInputError.at(field, f"these are {len(array)}; at most {MAX_POINTS} are read, so send less")
    return array


def _of_arrow(content: Content) -> NDArray[np.floating]:
    columns = arrow.read_floats(content, AXES[:2], AXES[2:])
    if len(columns["x"]) > MAX_POINTS:
        raise InvalidInputError.at("x", f"these are {len(columns['x'])} points; at most {MAX_POINTS} are read")
    return np.stack([columns[name] for name in AXES if name in columns], axis=1)


READERS: Mapping[str, Read] = {NPY: _of_npy, ARROW: _of_arrow, PCD: pcd.read, PLY: ply.read}
