"""Large JSON texts, read in pieces: checked against a form first, then a millisecond's work at a time."""

import json
import re
from collections.abc import Iterator
from typing import Any, TypeVar

import msgspec

from tidemap.errors import InvalidInputError, UnreadableBodyError

PIECE_BYTES = 1 << 16
"""Text that is read at once."""
Read = TypeVar("Read")
_ENDS = ((b"{", b"},"), (b'"', b'",'), (b"[", b"],"))
_WHERE = re.compile(r"^(?P<says>.*?)(?: - at `\$\.?(?P<path>[^`]*)`)?$", re.DOTALL)
_MISSING = re.compile(r"missing required field `([^`]*)`")
_UNKNOWN = re.compile(r"unknown field `([^`]*)`")


def fields_of(content: bytes | bytearray, form: type[Read]) -> Read:
    """The form, a msgspec struct whose long fields are `msgspec.Raw`: nothing of these is read yet.

    Raises UnreadableBodyError, InvalidInputError naming the first path that is wrong.
    """
    if not content.lstrip().startswith(b"{"):
        raise UnreadableBodyError("The body is no JSON object.")
    try:
        return msgspec.json.decode(content, type=form)
    except msgspec.ValidationError as error:
        raise _explained(str(error), form) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UnreadableBodyError(f"The body is no JSON: {error}.") from None


def list_parts(text: bytes, field: str) -> Iterator[list[Any]]:
    """The items of a list of numbers or texts in parts. Raises UnreadableBodyError, InvalidInputError."""
    text = text.strip()
    if len(text) <= PIECE_BYTES:
        whole = parsed(text)
        if not isinstance(whole, list):
            raise InvalidInputError.at(field, "send a list")
        yield whole
        return
    if not text.startswith(b"[") or b"\\" in text:
        raise InvalidInputError.at(field, "so long a value must be a list of numbers or times")
    for piece in _pieces(text[1:-1].strip()):
        yield parsed(b"[" + piece + b"]")


def parsed(text: bytes) -> Any:
    """The value of a short text. Raises UnreadableBodyError."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableBodyError(f"The body is no JSON: {error}.") from None


def _pieces(items: bytes) -> Iterator[bytes]:
    """The text of a list's items, cut between items: after a comma; of other than numbers, after their end and one."""
    separator = next((end for begin, end in _ENDS if begin in items), b",")
    start = 0
    while len(items) - start > PIECE_BYTES:
        end = items.find(separator, start + PIECE_BYTES)
        if end < 0:
            break
        end += len(separator) - 1
        yield items[start:end]
        start = end + 1
    yield items[start:]


def _explained(message: str, form: type[Any]) -> InvalidInputError:
    found = _WHERE.match(message)
    says, path = (found["says"], found["path"] or "") if found else (message, "")
    if unknown := _UNKNOWN.search(says):
        known = "remove it or check its spelling" if path else f"known are {', '.join(form.__struct_fields__)}"
        return InvalidInputError.at(f"{path}.{unknown[1]}".lstrip("."), f"this field is not known; {known}")
    if missing := _MISSING.search(says):
        return InvalidInputError.at(f"{path}.{missing[1]}".lstrip("."), "this field is missing")
    return InvalidInputError.at(path or "body", says[:1].lower() + says[1:])
