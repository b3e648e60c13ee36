"""OctoMap: trees of cells, as `.bt` (occupied or free) and as `.ot` (with probabilities); Hornung et al., 2013.

A tree has 16 levels. The code of a node at a depth is the path to it, three bits a level: x, y and z from the lowest
bit on. A node without children is a leaf and stands for all cells below it.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import UnreadableBodyError
from tidemap.formats.npy import UNSEEN
from tidemap.history.columns import Content
from tidemap.history.history import FREE, OCCUPIED
from tidemap.history.jit import kernel
from tidemap.space.grid import GridGeometry

DEPTH = 16
CENTRE = 1 << (DEPTH - 1)
"""The key of the cell whose lower corner is at zero."""
MAX_HEAD_BYTES = 65_536
MAX_LOG_ODDS = 6.9
"""Of a probability of .999; that of 1 is infinite."""
FREE_LEAF, OCCUPIED_LEAF, INNER = 1, 2, 3
"""Two bits say what a child is; 0 says that there is none."""
BINARY, FULL = "# Octomap OcTree binary file", "# Octomap OcTree file"
NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])
"""Of a `.ot`, in pre-order: a bit for each child that there is."""


@dataclass(frozen=True, slots=True, eq=False)
class OctoTree:
    """Leaves: code (n,) int64 and depth (n,) int64 as above; log_odds (n,) float32, occupied from 0 on."""

    resolution_m: float
    code: NDArray[np.int64]
    depth: NDArray[np.int64]
    log_odds: NDArray[np.float32]

    @property
    def edge(self) -> NDArray[np.int64]:
        """How many cells long the edge of each leaf is, (n,)."""
        return 1 << (DEPTH - self.depth)

    @property
    def key(self) -> NDArray[np.int64]:
        """OctoMap's key of the lowest cell of each leaf, (n, 3)."""
        code = self.code << 3 * (DEPTH - self.depth)
        return np.stack([_gather(code >> axis) for axis in range(3)], axis=1)

    def bounds(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The lowest key and one behind the highest, (3,) each. Raises UnreadableBodyError for an empty tree."""
        if not self.code.size:
            raise _unreadable("its tree has no leaves, so there is nothing in it")
        key = self.key
        return key.min(axis=0), (key + self.edge[:, np.newaxis]).max(axis=0)

    def grid(self, frame: str, low: NDArray[np.int64], stop: NDArray[np.int64]) -> GridGeometry:
        """The grid of the keys from `low` to before `stop`, (3,) each."""
        x, y, z = ((low - CENTRE) * self.resolution_m).tolist()
        return GridGeometry(frame, (x, y, z), self.resolution_m, tuple((stop - low).tolist()))

    def states(self, low: NDArray[np.int64], stop: NDArray[np.int64]) -> NDArray[np.uint8]:
        """The state of every cell of that grid, (n_cells,): FREE, OCCUPIED or UNSEEN."""
        found = np.full(np.prod(stop - low), UNSEEN, np.uint8)
        state = np.where(self.log_odds >= 0, OCCUPIED, FREE).astype(np.uint8)
        _fill(self.key - low, self.edge, state, stop - low, found)
        return found


def write_binary(
    resolution_m: float, key: NDArray[np.int64], occupied: NDArray[np.bool_], comments: tuple[str, ...] = ()
) -> bytes:
    """A `.bt` of cells with distinct keys (n, 3) from 0 to 65535, each occupied (n,) or free."""
    nodes = _nodes(key, np.where(occupied, 1, -1).astype(np.float32))
    words = nodes.word[nodes.word != 0]
    return b"".join([_head(BINARY, len(nodes.word), resolution_m, comments), words.astype("<u2").tobytes()])


def write(
    resolution_m: float, key: NDArray[np.int64], log_odds: NDArray[np.float32], comments: tuple[str, ...] = ()
) -> bytes:
    """A `.ot` of cells with distinct keys (n, 3) from 0 to 65535 and log odds (n,)."""
    nodes = _nodes(key, log_odds)
    rows = np.empty(len(nodes.word), NODE)
    rows["log_odds"], rows["children"] = nodes.log_odds, _children(nodes.word)
    return _head(FULL, len(rows), resolution_m, comments) + rows.tobytes()


def log_odds(probability: NDArray[np.float32]) -> NDArray[np.float32]:
    """The log odds of probabilities, at most MAX_LOG_ODDS from 0."""
    with np.errstate(divide="ignore"):
        found = np.log(probability) - np.log1p(-probability)
    return np.asarray(np.clip(found, -MAX_LOG_ODDS, MAX_LOG_ODDS), np.float32)


def _head(first: str, n_nodes: int, resolution_m: float, comments: tuple[str, ...]) -> bytes:
    advice = "# (feel free to add / change comments, but leave the first line as it is!)"
    lines = [first, advice, *(f"# {each}" for each in comments), "id OcTree", f"size {n_nodes}"]
    return "\n".join([*lines, f"res {resolution_m!r}", "data", ""]).encode()


@dataclass(frozen=True, slots=True, eq=False)
class _Nodes:
    """All nodes of a tree in pre-order, (n,) each; word: two bits a child, 0 for a leaf."""

    log_odds: NDArray[np.float32]
    word: NDArray[np.uint16]


def _nodes(key: NDArray[np.int64], log_odds: NDArray[np.float32]) -> _Nodes:
    """The tree of cells; equal leaves of one parent are one leaf, and a parent has its highest child's log odds."""
    if not len(key):
        return _Nodes(log_odds, np.zeros(0, np.uint16))
    code = sum((_part(key[:, axis]) << axis for axis in range(3)), np.zeros(len(key), np.int64))
    order = np.argsort(code)
    code, log_odds, word = code[order], log_odds[order], np.zeros(len(code), np.uint16)
    found = []
    for depth in range(DEPTH, 0, -1):
        first = np.flatnonzero(np.diff(code >> 3, prepend=-1))
        n = np.diff(first, append=len(code))
        high, low = np.maximum.reduceat(log_odds, first), np.minimum.reduceat(log_odds, first)
        pruned = (n == 8) & (high == low) & ~np.logical_or.reduceat(word != 0, first)
        kept = ~np.repeat(pruned, n)
        found.append((_preorder(code, depth)[kept], log_odds[kept], word[kept]))
        kind = np.where(word != 0, INNER, np.where(log_odds >= 0, OCCUPIED_LEAF, FREE_LEAF))
        words = np.bitwise_or.reduceat(kind << 2 * (code & 7), first)
        code, log_odds, word = code[first] >> 3, high, np.where(pruned, 0, words).astype(np.uint16)
    found.append((_preorder(code, 0), log_odds, word))
    where, *columns = (np.concatenate(each) for each in zip(*found, strict=True))
    order = np.argsort(where)
    return _Nodes(columns[0][order], columns[1][order])


def _preorder(code: NDArray[np.int64], depth: int) -> NDArray[np.int64]:
    """What nodes are sorted by: a parent before its children, and these before its next sibling."""
    return (code << 3 * (DEPTH - depth)) * (2 * DEPTH) + depth


def _children(word: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """A bit for each child that there is."""
    return sum((((word >> 2 * i) & 3 != 0).astype(np.uint8) << i for i in range(8)), np.zeros(len(word), np.uint8))


_SHIFTS = ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3))
_STEPS = (*_SHIFTS, (2, 0x1249249249249249))
"""How bits are moved apart by two, and what is kept of each move."""


def _part(key: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each bit of keys at three times its position."""
    for shift, mask in _STEPS:
        key = (key | key << shift) & mask
    return key


def _gather(code: NDArray[np.int64]) -> NDArray[np.int64]:
    """Every third bit, from the lowest on: the other way round."""
    masks = (*(mask for _, mask in reversed(_SHIFTS)), 0xFFFF)
    code = code & _STEPS[-1][1]
    for (shift, _), mask in zip(reversed(_STEPS), masks, strict=True):
        code = (code | code >> shift) & mask
    return code


def read(content: Content) -> OctoTree:
    """The tree of a `.bt` or `.ot`. Raises UnreadableBodyError."""
    head = bytes(content[:MAX_HEAD_BYTES])
    end = re.search(rb"^data *\r?\n", head, re.MULTILINE)
    lines = head[: end.start()].decode("latin-1").splitlines() if end else []
    if end is None or lines[0].strip() not in (BINARY, FULL):
        raise _unreadable(f"it does not begin with {BINARY!r} or {FULL!r} and a header that ends with a line 'data'")
    entries = {key: values for key, *values in (line.split() for line in lines if line.strip()) if key[0] != "#"}
    if entries.get("id") != ["OcTree"]:
        raise _unreadable(f"its id is {' '.join(entries.get('id', []))[:40]!r}; write an OcTree without colours")
    resolution = _resolution(entries.get("res", []))
    rest = memoryview(content)[end.end() :]
    return (_binary if lines[0].strip() == BINARY else _full)(resolution, rest)


def _unreadable(why: str) -> UnreadableBodyError:
    return UnreadableBodyError(f"This OctoMap file cannot be read: {why}.")


def _resolution(values: list[str]) -> float:
    try:
        resolution = float(values[0])
    except (ValueError, IndexError):
        resolution = 0.0
    if not 1e-6 <= resolution <= 1e6:
        raise _unreadable(f"its res is {' '.join(values)[:40]!r}; write the metres of a cell")
    return resolution


def _binary(resolution_m: float, content: memoryview) -> OctoTree:
    if len(content) % 2:
        raise _unreadable("its tree ends within a node. Send the whole file")
    words = np.frombuffer(content, "<u2").astype(np.uint16)
    leaves = int(np.bitwise_count((words ^ words >> 1) & 0x5555).sum())
    code, depth, occupied = np.empty(leaves, np.int64), np.empty(leaves, np.int64), np.empty(leaves, np.bool_)
    _check_length(_walk_binary(words, code, depth, occupied) if words.size else 0, words.size)
    return OctoTree(resolution_m, code, depth, np.where(occupied, 1, -1).astype(np.float32))


def _full(resolution_m: float, content: memoryview) -> OctoTree:
    if len(content) % NODE.itemsize:
        raise _unreadable("its tree ends within a node. Send the whole file")
    rows = np.frombuffer(content, NODE)
    children = np.ascontiguousarray(rows["children"])
    code, depth = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    _check_length(_walk_full(children, code, depth) if len(rows) else 0, len(rows))
    leaf = children == 0
    log_odds = rows["log_odds"][leaf].astype(np.float32)
    if np.isnan(log_odds).any():
        raise _unreadable("it has cells with a probability of NaN")
    return OctoTree(resolution_m, code[leaf], depth[leaf], log_odds)


def _check_length(read: int, nodes: int) -> None:
    if read == DEEPER:
        raise _unreadable(f"its tree has more than {DEPTH} levels, or ends too early. Send the whole file")
    if read != nodes:
        raise _unreadable(f"its tree has {read} nodes, but {nodes - read} follow. Send the whole file and nothing else")


DEEPER = -1


@kernel
def _walk_binary(
    words: NDArray[np.uint16], code: NDArray[np.int64], depth: NDArray[np.int64], occupied: NDArray[np.bool_]
) -> int:
    """Write the leaves. Returns how many inner nodes were read, DEEPER where the tree is none."""
    base, child, n, at, level = np.zeros(DEPTH, np.int64), np.zeros(DEPTH, np.int64), 0, 1, 0
    word = np.zeros(DEPTH, np.uint16)
    word[0] = words[0]
    while level >= 0:
        i = child[level]
        if i == 8:
            level -= 1
            continue
        child[level] += 1
        kind = (int(word[level]) >> (2 * i)) & 3
        here = base[level] * 8 + i
        if kind == INNER:
            if level + 1 == DEPTH or at == len(words):
                return DEEPER
            level += 1
            base[level], child[level], word[level] = here, 0, words[at]
            at += 1
        elif kind != 0:
            code[n], depth[n], occupied[n] = here, level + 1, kind == OCCUPIED_LEAF
            n += 1
    return at


@kernel
def _walk_full(children: NDArray[np.uint8], code: NDArray[np.int64], depth: NDArray[np.int64]) -> int:
    """Write where each node is. Returns how many were read, DEEPER where the tree is none."""
    left, base, at, level = np.zeros(DEPTH + 1, np.int64), np.zeros(DEPTH + 1, np.int64), 1, 0
    code[0], depth[0], left[0] = 0, 0, children[0]
    while level >= 0:
        if left[level] == 0:
            level -= 1
            continue
        i = 0
        while not (left[level] >> i) & 1:
            i += 1
        left[level] &= left[level] - 1
        if level == DEPTH or at == len(children):
            return DEEPER
        level += 1
        base[level] = base[level - 1] * 8 + i
        code[at], depth[at], left[level] = base[level], level, children[at]
        at += 1
    return at


@kernel
def _fill(
    low: NDArray[np.int64],
    edge: NDArray[np.int64],
    state: NDArray[np.uint8],
    shape: NDArray[np.int64],
    found: NDArray[np.uint8],
) -> None:
    """Write the state of every leaf to those of its cells that are in the grid."""
    for leaf in range(len(low)):
        for i in range(max(low[leaf, 0], 0), min(low[leaf, 0] + edge[leaf], shape[0])):
            for j in range(max(low[leaf, 1], 0), min(low[leaf, 1] + edge[leaf], shape[1])):
                row = (i * shape[1] + j) * shape[2]
                for k in range(max(low[leaf, 2], 0), min(low[leaf, 2] + edge[leaf], shape[2])):
                    found[row + k] = state[leaf]
