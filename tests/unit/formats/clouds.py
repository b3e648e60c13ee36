"""Clouds as other programs write them."""

import struct

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.void]


def rows(points: NDArray[np.floating], kind: str = "<f4") -> Rows:
    """Points (n, 3) with an intensity in front of z, as a scanner's driver has it."""
    found = np.zeros(len(points), np.dtype([("x", kind), ("y", kind), ("intensity", "<u2"), ("z", kind)]))
    for axis, name in enumerate("xyz"):
        found[name] = points[:, axis]
    found["intensity"] = np.arange(len(points))
    return found


def text(table: Rows) -> bytes:
    return "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist()).encode()


def pcd_head(table: Rows, data: str, **changes: str) -> bytes:
    """A header; a change to an empty text leaves the line out."""
    kinds = [table.dtype[name] for name in table.dtype.names or ()]
    entries = {
        "VERSION": "0.7",
        "FIELDS": " ".join(table.dtype.names or ()),
        "SIZE": " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE": " ".join(kind.kind.upper() for kind in kinds),
        "COUNT": " ".join("1" for _ in kinds),
        "WIDTH": str(len(table)),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(len(table)),
        "DATA": data,
    } | changes
    lines = [f"{key} {value}" for key, value in entries.items() if value]
    return "\n".join(["# .PCD v0.7 - Point Cloud Data file format", *lines, ""]).encode()


def pcd(table: Rows, data: str) -> bytes:
    if data == "binary_compressed":
        return pcd_head(table, data) + compressed(table)
    return pcd_head(table, data) + (text(table) if data == "ascii" else table.tobytes())


def compressed(table: Rows) -> bytes:
    """Field after field, packed by LZF, behind both sizes."""
    plain = b"".join(table[name].tobytes() for name in table.dtype.names or ())
    packed = lzf(plain)
    return struct.pack("<II", len(packed), len(plain)) + packed


def lzf(plain: bytes) -> bytes:
    """Packed with what was seen before of three bytes, in the plainest way."""
    packed, literal, seen, at = bytearray(), bytearray(), dict[bytes, int](), 0

    def flush() -> None:
        for start in range(0, len(literal), 32):
            part = literal[start : start + 32]
            packed.extend([len(part) - 1, *part])
        literal.clear()

    while at < len(plain):
        source = seen.get(plain[at : at + 3], -9999) if at + 3 <= len(plain) else -9999
        seen[plain[at : at + 3]] = at
        if at - source > 8192:
            literal.append(plain[at])
            at += 1
            continue
        flush()
        length = 3
        while length < 264 and at + length < len(plain) and plain[source + length] == plain[at + length]:
            length += 1
        back = at - source - 1
        short = min(length - 2, 7)
        packed.append(short << 5 | back >> 8)
        packed.extend([length - 9] if short == 7 else [])
        packed.append(back & 255)
        at += length
    flush()
    return bytes(packed)


PLY_TYPES = {"<f4": "float", "<f8": "double", "<u2": "ushort"}


def ply_head(table: Rows, kind: str, before: str = "", after: str = "") -> bytes:
    properties = [f"property {PLY_TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    vertex = [f"element vertex {len(table)}", *properties]
    others = [*filter(None, [before]), *vertex, *filter(None, [after])]
    return "\n".join(["ply", f"format {kind} 1.0", "comment von Hand geprüft", *others, "end_header", ""]).encode()


def ply(table: Rows, kind: str) -> bytes:
    if kind == "ascii":
        return ply_head(table, kind) + text(table)
    swapped = table.astype(table.dtype.newbyteorder(">")) if kind == "binary_big_endian" else table
    return ply_head(table, kind) + swapped.tobytes()
