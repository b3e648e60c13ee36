"""Bodies of scans: a JSON header and, beside it, points or ranges; or ranges as JSON alone."""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import xxhash

from tidemap.errors import DomainError, InvalidInputError, UnsupportedMediaTypeError
from tidemap.formats import multipart, pcd
from tidemap.formats.multipart import Part
from tidemap.formats.registry import Body
from tidemap.history.columns import Content
from tidemap.media_types import JSON, MULTIPART, PCD

COST = 16
"""`Body.cost` of a multipart scan: float32 becomes float64 in the frames of the sensor, the map and the cells."""
JSON_COST = 24
MAX_HEADER_BYTES = 1 << 22
HEADER, POINTS, RANGES = "header", "points", "ranges"


@dataclass(frozen=True, slots=True, eq=False)
class ScanParts:
    """The JSON header of a scan, and beside it points or ranges; of JSON alone neither."""

    header: Content
    points: Part | None
    ranges: Part | None


@dataclass(frozen=True)
class ScanBody(Body):
    """A body whose `media_type` is the whole Content-Type, for its boundary."""

    @cached_property
    def parts(self) -> ScanParts:
        """Raises UnsupportedMediaTypeError, UnreadableBodyError, InvalidInputError."""
        kind = self.media_type.partition(";")[0].strip().lower()
        if kind == JSON:
            return ScanParts(self.content, None, None)
        if kind != MULTIPART:
            raise UnsupportedMediaTypeError(
                f"Content-Type {kind!r} is not read here; send {MULTIPART} with the parts {HEADER} and {POINTS} "
                f"(or {RANGES}), or ranges as {JSON}."
            )
        return _named(multipart.read(self.content, self.media_type))

    @cached_property
    def digest(self) -> bytes:
        """What distinguishes two scans; the boundary does not."""
        digest = xxhash.xxh3_128()
        for part in (self.parts.points, self.parts.ranges):
            media_type, content = ("", b"") if part is None else (part.media_type, part.content)
            digest.update(f"{media_type} {len(content)}\0".encode())
            digest.update(content)
        digest.update(self.parts.header)
        return digest.digest()

    def hidden_bytes(self) -> int:
        """Bytes that compressed points unpack to, beside the content; they cost as the content does.

        0 where the body cannot be read: who parses it says why.
        """
        with suppress(DomainError):
            points = self.parts.points
            if points is not None and points.media_type == PCD:
                return pcd.unpacked_bytes(points.content)
        return 0

    @property
    def cost(self) -> int:
        """As of `Body`."""
        return JSON_COST if self.media_type.startswith(JSON) else COST


def _named(found: dict[str, Part]) -> ScanParts:
    unknown = found.keys() - {HEADER, POINTS, RANGES}
    if unknown or HEADER not in found or (POINTS in found) == (RANGES in found):
        raise InvalidInputError.at(
            sorted(unknown)[0][:100] if unknown else HEADER,
            f"send the parts {HEADER} (JSON) and {POINTS}, or {HEADER} and {RANGES}, and no other",
        )
    header = found[HEADER]
    if header.media_type not in (JSON, ""):
        raise UnsupportedMediaTypeError(f"The part {HEADER!r} is {header.media_type!r}; send {JSON}.")
    if len(header.content) > MAX_HEADER_BYTES:
        raise InvalidInputError.at(HEADER, f"it has {len(header.content)} bytes; at most {MAX_HEADER_BYTES} are read")
    return ScanParts(header.content, found.get(POINTS), found.get(RANGES))
