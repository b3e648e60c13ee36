"""PLY: the vertices of polygon files, as text and as binary of either order of bytes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.formats.cloud import ROW, CloudField, CloudLayout, Points, count_of, head_lines, rows_of, unreadable
from tidemap.history.columns import Content

SHORT = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
SIZED = {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
TYPES = {**SHORT, **SIZED, "float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}
ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
"""The formats, each with its order of bytes."""
MAX_PROPERTIES = 1000
MAX_OTHERS = 10**12
"""Rows of elements that are no vertices; they are not read."""


@dataclass(frozen=True, slots=True)
class PlyElement:
    """`n` rows of one layout; `lists` where rows differ in length."""

    name: str
    n: int
    layout: CloudLayout
    lists: bool


def read(content: Content) -> Points:
    """Vertices (n, 3) of a PLY file, NaN where it has NaN. Raises UnreadableBodyError.

    No memory is taken before the sizes that the header declares are those of the content.
    """
    if bytes(content[:4]) not in (b"ply\n", b"ply\r"):
        raise unreadable("PLY", "it does not begin with a line 'ply'")
    lines, start = head_lines("PLY", content, b"end_header")
    words = [line.split() for line in lines[1:-1] if line.strip()]
    kind = _kind(words)
    before, vertex, after = _around_vertices(_elements(words, ORDERS[kind]))
    vertex.layout.check()
    if kind == "ascii":
        skip = sum(each.n for each in before)
        return vertex.layout.text(content, start, vertex.n, skip=skip, more=bool(after))
    return _packed(content, start, before, vertex, bool(after))


def write(points: NDArray[np.float64], probability: NDArray[np.float32]) -> bytes:
    """A little-endian binary PLY of points (n, 3) with their probability (n,)."""
    properties = [f"property float {name}" for name in ROW.names or ()]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *properties, "end_header", ""]
    return "\n".join(lines).encode() + rows_of(points, probability).tobytes()


def _kind(words: Iterable[list[str]]) -> str:
    kinds = [line[1:] for line in words if line[0] == "format"]
    if len(kinds) != 1 or kinds[0] not in ([each, "1.0"] for each in ORDERS):
        named = " ".join(kinds[0])[:60] if kinds else "not stated"
        raise unreadable("PLY", f"its format is {named}; write one of {', '.join(ORDERS)}, version 1.0")
    return kinds[0][0]


def _elements(words: Iterable[list[str]], order: str) -> list[PlyElement]:
    heads: list[list[str]] = []
    properties: list[list[list[str]]] = []
    for line in words:
        if line[0] == "element":
            heads.append(line)
            properties.append([])
        elif line[0] == "property":
            if not heads:
                raise unreadable("PLY", "its header has a property before the first element")
            properties[-1].append(line)
        elif line[0] not in ("format", "comment", "obj_info"):
            raise unreadable("PLY", f"its header has a line that begins with {line[0][:40]!r}")
    return [_element(head, lines, order) for head, lines in zip(heads, properties, strict=True)]


def _element(head: list[str], properties: list[list[str]], order: str) -> PlyElement:
    if len(head) != 3:
        raise unreadable("PLY", f"{' '.join(head)[:60]!r} is no 'element NAME NUMBER'")
    if len(properties) > MAX_PROPERTIES:
        raise unreadable("PLY", f"an element has {len(properties)} properties; at most {MAX_PROPERTIES} are read")
    n = count_of("PLY", "points", head[2]) if head[1] == "vertex" else count_of("PLY", "rows", head[2], MAX_OTHERS)
    plain = [line for line in properties if line[1:2] != ["list"]]
    layout = CloudLayout("PLY", tuple(_field(line, order) for line in plain))
    return PlyElement(head[1], n, layout, len(plain) < len(properties))


def _field(line: list[str], order: str) -> CloudField:
    if len(line) != 3 or line[1] not in TYPES:
        raise unreadable("PLY", f"{' '.join(line)[:60]!r} is no 'property TYPE NAME' of a known type")
    return CloudField(line[2], np.dtype(order + TYPES[line[1]]))


def _around_vertices(elements: list[PlyElement]) -> tuple[list[PlyElement], PlyElement, list[PlyElement]]:
    """The elements before the vertices, these, and those behind them."""
    names = [each.name for each in elements]
    if names.count("vertex") != 1:
        raise unreadable("PLY", f"it has {names.count('vertex')} elements 'vertex'; write one")
    at = names.index("vertex")
    if elements[at].lists:
        raise unreadable("PLY", "its vertices have lists; write x, y and z alone")
    return elements[:at], elements[at], elements[at + 1 :]


def _packed(content: Content, start: int, before: list[PlyElement], vertex: PlyElement, more: bool) -> Points:
    if any(each.lists and each.n for each in before):
        raise unreadable("PLY", "it has lists before its vertices; write the vertices first")
    first = start + sum(each.n * each.layout.row_bytes for each in before)
    size, found = vertex.n * vertex.layout.row_bytes, len(content) - first
    if found < size or (found > size and not more):
        raise unreadable(
            "PLY", f"its vertices have {size} bytes, but {max(found, 0)} follow. Send the whole file and nothing else"
        )
    return vertex.layout.packed(content, first, vertex.n)
