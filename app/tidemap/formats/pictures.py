"""Pictures of maps: grey values, and which pixels are transparent, in PGM and PNG."""

import io
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tidemap.errors import UnreadableBodyError
from tidemap.history.columns import Content

MAX_SIDE = 65_536
"""Pixels along an edge."""
MAX_PIXELS = 128 * 2**20
MAX_WHITE = 255
"""The highest value of one byte."""
MAX_HEAD_BYTES = 4096
"""Bytes of the longest header of a PGM."""
NUMBER = re.compile(rb"(?:\s|#[^\n]*\n)+([0-9]{1,9})(?=\s)")
"""Of a PGM's header; comments may stand in front of it."""
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, slots=True, eq=False)
class MapPicture:
    """value (height, width) uint8 from black, 0, to `white`; opaque (height, width), None where all pixels are."""

    value: NDArray[np.uint8]
    white: int = MAX_WHITE
    opaque: NDArray[np.bool_] | None = None


def read(content: Content) -> MapPicture:
    """The picture of a binary PGM, or of a PNG: of its colours the mean. Raises UnreadableBodyError."""
    if bytes(content[: len(PNG_SIGNATURE)]) == PNG_SIGNATURE:
        return _read_png(content)
    if bytes(content[:2]) == b"P5":
        return _read_pgm(content)
    raise unreadable("its image is neither a binary PGM, which begins with P5, nor a PNG. Save it as one of them")


def write_pgm(value: NDArray[np.uint8]) -> bytes:
    """A binary PGM of values (height, width)."""
    height, width = value.shape
    return b"P5\n%d %d\n255\n" % (width, height) + value.tobytes()


def write_png(picture: MapPicture) -> bytes:
    """A PNG with a channel of transparency."""
    opaque = np.full(picture.value.shape, 255, np.uint8) if picture.opaque is None else picture.opaque * np.uint8(255)
    packed = io.BytesIO()
    Image.fromarray(np.stack([picture.value, opaque], axis=2), "LA").save(packed, "PNG")
    return packed.getvalue()


def unreadable(why: str) -> UnreadableBodyError:
    """What is raised for a map that cannot be read."""
    return UnreadableBodyError(f"This map cannot be read: {why}.")


def _read_pgm(content: Content) -> MapPicture:
    head, at, numbers = bytes(content[:MAX_HEAD_BYTES]), 2, []
    for what, most in (("width", MAX_SIDE), ("height", MAX_SIDE), ("white", MAX_WHITE)):
        found = NUMBER.match(head, at)
        if found is None or not 1 <= int(found[1]) <= most:
            raise unreadable(f"the {what} of its PGM is no whole number from 1 to {most}")
        numbers.append(int(found[1]))
        at = found.end()
    width, height, white = numbers
    start = at + 1  # one space or end of line
    if len(content) - start != width * height:
        raise unreadable(f"its PGM declares {width} x {height} pixels, but {max(len(content) - start, 0)} bytes follow")
    value = np.frombuffer(content, np.uint8, width * height, start).reshape(height, width)
    if value.max() > white:
        raise unreadable(f"its PGM has values above {white}, which it declares as white")
    return MapPicture(value, white)


def _read_png(content: Content) -> MapPicture:
    try:
        with Image.open(io.BytesIO(content), formats=("PNG",)) as image:
            _check_size(*image.size)
            if image.mode.startswith("I"):
                raise unreadable("its PNG has 16 bits a value. Save it with 8")
            values = np.asarray(image.convert("RGBA"))
    except UnreadableBodyError:
        raise
    except Exception as error:  # a damaged PNG fails in many ways
        raise unreadable(f"its PNG is damaged: {str(error)[:200]}") from None
    opaque = values[..., 3] == 255
    mean = np.rint(values[..., :3].astype(np.float32).mean(axis=2)).astype(np.uint8)
    return MapPicture(mean, opaque=None if opaque.all() else opaque)


def _check_size(width: int, height: int) -> None:
    if max(width, height) > MAX_SIDE or width * height > MAX_PIXELS:
        raise unreadable(f"its image has {width} x {height} pixels; at most {MAX_PIXELS} are read")
