"""How arrays become the bytes of a row: a version byte, a CRC-32, then a zstd frame of a header and the raw columns.

Layout of a sealed blob: `version u8 | crc32 of the rest u32le | zstd(header length u32le | header JSON | columns)`,
the frame with a dictionary of common headers. The checksum of a version above 1 begins with the version.
Arrays are little-endian in C order, so the bytes are the same on every machine.
"""

import json
import struct
import zlib
from collections.abc import Mapping
from functools import partial
from threading import local

import numpy as np
import zstandard
from numpy.typing import NDArray

from tidemap.errors import CorruptChunkError, LaterFormatError

VERSION = 1
"""Of the layout; a blob whose contents an earlier version would not understand has a higher one."""
_PREFIX = struct.Struct("<BI")
_LENGTH = struct.Struct("<I")
QUICK, SMALL = 3, 9
"""Levels of zstd: for what is written with every post, and for what is kept. 12 saves 3 %,
and takes half as long again for history, thrice for ranks that differ from cell to cell."""
HEADERS = zstandard.ZstdCompressionDict(
    b'[["link", "|S8", []], ["origin_s", "<f8", []], ["time_zone", "|S13", []], ["frequency_hz", "<f8", []], '
    b'["gate", "|u1", []], ["mean", "<f4", [1024]], ["cell", "<i4", []], ["index", "<u2", []], '
    b'["coefficient", "<c8", []]][["json", "|S9", []]][["seen", "|u1", []], ["sample", "|u1", [4096]], '
    b'["row", "|u1", [1024]], ["state", "|u1", [10, 512]], ["stands", "|u1", [1024]], '
    b'["rank", "|u1", [1024, 4096]], ["time", "<i8", []]]',
    dict_type=zstandard.DICT_TYPE_RAWCONTENT,
)
"""What most headers say, a tenth of a small blob: SMALL refers to it, QUICK would take twice as long with it.

Another one cannot read what was written with this one: it belongs to VERSION."""
_per_thread = local()

Columns = Mapping[str, NDArray[np.generic]]


def seal(columns: Columns, level: int = QUICK, version: int = VERSION) -> bytes:
    """Pack named arrays into one blob.

    >>> unseal(seal({"cell": np.arange(3, dtype=np.uint32)}), "doc")["cell"].tolist()
    [0, 1, 2]
    """
    arrays = {name: np.asarray(column, order="C") for name, column in columns.items()}
    header = json.dumps([[name, array.dtype.str, array.shape] for name, array in arrays.items()]).encode()
    parts = [_LENGTH.pack(len(header)), header, *(array.tobytes() for array in arrays.values())]
    frame = _compressor(level).compress(b"".join(parts))
    return _PREFIX.pack(version, _checksum(frame, version)) + frame


def unseal(blob: bytes, what: str, *names: str, latest: int = VERSION) -> dict[str, NDArray[np.generic]]:
    """The arrays of a blob of a version up to `latest`, read-only.

    Raises CorruptChunkError naming `what` when it is not as it was sealed, or lacks one of the names; LaterFormatError
    when it is whole and of a later version.
    """
    problem = partial(CorruptChunkError, what)
    if len(blob) < _PREFIX.size:
        raise problem("it is cut short")
    version, checksum = _PREFIX.unpack_from(blob)
    frame = memoryview(blob)[_PREFIX.size :]
    whole = _checksum(frame, version) == checksum
    if not VERSION <= version <= latest:
        error = LaterFormatError if whole and version > latest else CorruptChunkError
        raise error(what, f"its format is {version}, this version reads {latest}")
    if not whole:
        raise problem("its checksum is wrong")
    try:
        columns = _split(_decompressor().decompress(frame))
    except (zstandard.ZstdError, ValueError, struct.error, TypeError) as error:
        raise problem(str(error)) from error
    if missing := [name for name in names if name not in columns]:
        raise problem(f"it is of another kind, without {', '.join(missing)}")
    return columns


def _checksum(frame: bytes | memoryview, version: int) -> int:
    """Of the first version without the version itself."""
    return zlib.crc32(frame, 0 if version == VERSION else version)


def _split(body: bytes) -> dict[str, NDArray[np.generic]]:
    (length,) = _LENGTH.unpack_from(body)
    position = _LENGTH.size + length
    columns: dict[str, NDArray[np.generic]] = {}
    for name, dtype, shape in json.loads(body[_LENGTH.size : position]):
        count = int(np.prod(shape, dtype=np.int64))
        array = np.frombuffer(body, np.dtype(dtype), count, position)
        columns[name] = array.reshape(shape)
        position += array.nbytes
    return columns


def _compressor(level: int) -> zstandard.ZstdCompressor:
    if not hasattr(_per_thread, "compressors"):
        _per_thread.compressors = {
            QUICK: zstandard.ZstdCompressor(level=QUICK),
            SMALL: zstandard.ZstdCompressor(level=SMALL, dict_data=HEADERS),
        }
    compressor: zstandard.ZstdCompressor = _per_thread.compressors[level]
    return compressor


def _decompressor() -> zstandard.ZstdDecompressor:
    if not hasattr(_per_thread, "decompressor"):
        _per_thread.decompressor = zstandard.ZstdDecompressor(dict_data=HEADERS)
    decompressor: zstandard.ZstdDecompressor = _per_thread.decompressor
    return decompressor
