"""Files: read whole or line by line, gzip unpacked, within limits."""

import gzip
import hashlib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from tidemap.errors import UnreadableBodyError, UnusableFileError

MAX_FILE_BYTES = 2**31
"""Of a file that is read whole."""
BLOCK_BYTES = 1 << 20


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Within it what cannot be read is an UnusableFileError that names the file."""
    try:
        yield
    except UnreadableBodyError as error:
        raise UnusableFileError(path, str(error)) from None
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise UnusableFileError(path, f"It is a damaged gzip file ({error}). Copy it again.") from None


def suffix_of(path: Path) -> str:
    """The ending of a name in small letters, that before `.gz` for a packed file."""
    return (path.with_suffix("") if path.suffix.lower() == ".gz" else path).suffix.lower()


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A file for reading, unpacked if it ends in `.gz`."""
    with gzip.open(path, "rb") if path.suffix.lower() == ".gz" else path.open("rb") as file:
        yield cast(BinaryIO, file)


def content_of(path: Path) -> bytes:
    """All of a file. Raises UnreadableBodyError."""
    with opened(path) as file:
        content = file.read(MAX_FILE_BYTES + 1)
    if len(content) > MAX_FILE_BYTES:
        raise UnreadableBodyError(f"It has more than {MAX_FILE_BYTES} bytes. Send it in parts.")
    return content


def digest_of(path: Path) -> str:
    """What distinguishes the content of a file, or of all files of a folder and their names."""
    digest = hashlib.sha256()
    for file in sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]:
        digest.update(file.name.encode() + b"\0")
        with file.open("rb") as content:
            while block := content.read(BLOCK_BYTES):
                digest.update(block)
    return digest.hexdigest()
