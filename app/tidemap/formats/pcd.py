"""PCD: clouds of the Point Cloud Library, version 0.7, as text, binary and binary_compressed."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.cloud import (
    MAX_ROW_BYTES,
    ROW,
    CloudField,
    CloudLayout,
    Points,
    count_of,
    head_lines,
    rows_of,
    unreadable,
)
from tidemap.history.columns import Content
from tidemap.history.jit import kernel

COMPRESSED = "binary_compressed"
TYPES = {f"{kind}{size}" for kind in "IU" for size in (1, 2, 4, 8)} | {"F4", "F8"}
MAX_FIELDS = 1000


def read(content: Content) -> Points:
    """Points (n, 3) of a PCD file, NaN where it has NaN. Raises UnreadableBodyError.

    No memory is taken before the sizes that the header declares are those of the content.
    """
    head = _head(content)
    layout, n, start = head.layout, head.n, head.start
    if head.data == "ascii":
        return layout.text(content, start, n)
    if head.data == "binary":
        if head.size != len(content) - start:
            raise _wrong_length(head.size, len(content) - start)
        return layout.packed(content, start, n)
    if head.data == COMPRESSED:
        return layout.planar(_unpacked(content, head), n)
    raise unreadable("PCD", f"its DATA is {head.data[:40]!r}; write ascii, binary or {COMPRESSED}")


def unpacked_bytes(content: Content) -> int:
    """Bytes that `read` unpacks beside the content: 0 unless it is compressed. Raises UnreadableBodyError."""
    head = _head(content)
    if head.data != COMPRESSED:
        return 0
    _packed_bytes(content, head)
    return head.size


def write(points: NDArray[np.float64], probability: NDArray[np.float32]) -> bytes:
    """A binary PCD of points (n, 3) with their probability (n,)."""
    names, n = ROW.names or (), len(points)
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", f"FIELDS {' '.join(names)}"]
    lines += [
        f"{key} {' '.join([value] * len(names))}" for key, value in (("SIZE", "4"), ("TYPE", "F"), ("COUNT", "1"))
    ]
    lines += [f"WIDTH {n}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {n}", "DATA binary", ""]
    return "\n".join(lines).encode() + rows_of(points, probability).tobytes()


@dataclass(frozen=True, slots=True)
class PcdHead:
    """What the header of a PCD file says: `n` rows, kept as `data` names it from `start` on."""

    layout: CloudLayout
    n: int
    data: str
    start: int

    @property
    def size(self) -> int:
        """Bytes of all rows that are not compressed."""
        return self.n * self.layout.row_bytes


def _head(content: Content) -> PcdHead:
    """What the file begins with. Raises UnreadableBodyError."""
    lines, start = head_lines("PCD", content, b"DATA")
    entries = {key: values for key, *values in (line.split() for line in lines if line.strip()) if key[0] != "#"}
    layout = _layout(entries)
    layout.check()
    return PcdHead(layout, _number_of_points(entries), " ".join(_entry(entries, "DATA")), start)


def _layout(entries: Mapping[str, list[str]]) -> CloudLayout:
    names = _entry(entries, "FIELDS")
    if len(names) > MAX_FIELDS:
        raise unreadable("PCD", f"it has {len(names)} fields; leave some out, at most {MAX_FIELDS} are read")
    sizes, kinds = _entry(entries, "SIZE"), _entry(entries, "TYPE")
    counts = entries.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise unreadable("PCD", "its FIELDS, SIZE, TYPE and COUNT are not of one length")
    fields = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        if kind + size not in TYPES:
            raise unreadable(
                "PCD", f"its field {name[:40]} is of TYPE {kind[:9]} and SIZE {size[:9]}, which is no type"
            )
        number = count_of("PCD", f"values of {name[:40]}", count, MAX_ROW_BYTES)
        fields.append(CloudField(name, np.dtype(f"<{kind.lower()}{size}"), number))
    return CloudLayout("PCD", tuple(fields))


def _entry(entries: Mapping[str, list[str]], key: str) -> list[str]:
    if key not in entries:
        raise unreadable("PCD", f"its header has no line {key}")
    return entries[key]


def _number_of_points(entries: Mapping[str, list[str]]) -> int:
    width, height = (
        count_of("PCD", what, " ".join(_entry(entries, key)))
        for key, what in (("WIDTH", "columns"), ("HEIGHT", "rows"))
    )
    n = count_of("PCD", "points", str(width * height))
    if "POINTS" in entries and count_of("PCD", "points", " ".join(entries["POINTS"])) != n:
        raise unreadable("PCD", f"its POINTS are not WIDTH times HEIGHT, which is {n}")
    return n


def _wrong_length(declared: int, found: int) -> Exception:
    return unreadable(
        "PCD", f"its header declares {declared} bytes, but {found} follow. Send the whole file and nothing else"
    )


def _unpacked(content: Content, head: PcdHead) -> memoryview:
    """The bytes of all rows that stand compressed in `content`. Raises UnreadableBodyError."""
    packed = _packed_bytes(content, head)
    found = np.empty(head.size, np.uint8)
    if _expand(np.frombuffer(content, np.uint8, packed, head.start + 8), found) != head.size:
        raise unreadable("PCD", "its compressed points are damaged")
    return found.data


def _packed_bytes(content: Content, head: PcdHead) -> int:
    """How many compressed bytes there are. Raises UnreadableBodyError unless they can be what the header declares."""
    start, size = head.start, head.size
    if len(content) - start < 8:
        raise unreadable("PCD", "it ends before the sizes of its compressed points")
    packed: int
    packed, unpacked = struct.unpack_from("<II", content, start)
    if unpacked != size:
        raise unreadable("PCD", f"its header declares {size} bytes, but its compressed points {unpacked}")
    if packed != len(content) - start - 8:
        raise _wrong_length(packed, len(content) - start - 8)
    if size > MAX_UNPACKED_BYTES:
        raise unreadable("PCD", f"its points would be {size} bytes; at most {MAX_UNPACKED_BYTES} are unpacked")
    if size > packed * MAX_GROWTH:
        raise unreadable("PCD", f"its {packed} compressed bytes cannot be {size} bytes of points")
    return packed


MAX_UNPACKED_BYTES = 1 << 28
"""Bytes that compressed points may unpack to: they are in memory beside the body."""
MAX_GROWTH = 88
"""Three bytes of LZF stand for at most 264."""


@kernel
def _expand(packed: NDArray[np.uint8], found: NDArray[np.uint8]) -> int:
    """Unpack LZF into `found`. Returns the number of bytes, -1 where the content breaks off or points outside.

    A byte below 32 is followed by one more literal byte than it says. Others have in their upper three bits how many
    bytes, less two, are repeated (7: add the next byte), and in the lower five with the next byte how far back, less
    one.
    """
    at, end = 0, 0
    while at < len(packed):
        control = int(packed[at])
        at += 1
        if control < 32:
            length = control + 1
            if at + length > len(packed) or end + length > len(found):
                return -1
            found[end : end + length] = packed[at : at + length]
            at += length
        else:
            length = control >> 5
            if length == 7:
                if at >= len(packed):
                    return -1
                length += int(packed[at])
                at += 1
            length += 2
            if at >= len(packed):
                return -1
            source = end - ((control & 31) << 8) - int(packed[at]) - 1
            at += 1
            if source < 0 or end + length > len(found):
                return -1
            for i in range(length):  # what is repeated may be what is being written
                found[end + i] = found[source + i]
        end += length
    return end
