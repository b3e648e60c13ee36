"""multipart/form-data (RFC 7578): a body of a few named parts, each with a media type."""

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import MultipartParser, parse_options_header

from tidemap.errors import UnreadableBodyError
from tidemap.history.columns import Content
from tidemap.media_types import MULTIPART

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

MAX_PARTS = 8
MAX_BOUNDARY = 200


@dataclass(slots=True)
class Part:
    """What one part says of itself, and its content."""

    headers: dict[str, str] = field(default_factory=dict)
    content: bytearray = field(default_factory=bytearray)

    @property
    def name(self) -> str:
        """The field that it is."""
        options = parse_options_header(self.headers.get("content-disposition", ""))[1]
        return options.get(b"name", b"").decode("utf-8", "replace")

    @property
    def media_type(self) -> str:
        """Its media type in lower case, '' where that is not said."""
        return self.headers.get("content-type", "").partition(";")[0].strip().lower()


def read(content: Content, content_type: str) -> dict[str, Part]:
    """The parts of a body by name, whose header says `content_type`. Raises UnreadableBodyError."""
    reader = _Reader()
    try:
        parser = MultipartParser(_boundary(content_type), reader.callbacks())
        parser.write(bytes(content))
        parser.finalize()
    except MultipartParseError as error:
        raise UnreadableBodyError(f"The body is no {MULTIPART}: {error}.") from None
    if not reader.ended:
        raise UnreadableBodyError(f"The {MULTIPART} body is cut short: the line that ends it is missing.")
    found = {part.name: part for part in reader.parts}
    if len(found) != len(reader.parts):
        raise UnreadableBodyError("Two parts of the body have the same name, or parts have none.")
    return found


def _boundary(content_type: str) -> bytes:
    boundary = parse_options_header(content_type)[1].get(b"boundary", b"")
    if not boundary or len(boundary) > MAX_BOUNDARY:
        raise UnreadableBodyError(f"The Content-Type of a {MULTIPART} body needs a boundary, as HTTP libraries set it.")
    return boundary


class _Reader:
    """Collects what the parser reports."""

    def __init__(self) -> None:
        self.parts: list[Part] = []
        self.ended = False
        self._name = self._value = b""

    def callbacks(self) -> "MultipartCallbacks":
        """By the parser's names."""
        return {
            "on_part_begin": self._part_begin,
            "on_part_data": self._part_data,
            "on_header_field": self._header_field,
            "on_header_value": self._header_value,
            "on_header_end": self._header_end,
            "on_end": self._end,
        }

    def _part_begin(self) -> None:
        if len(self.parts) == MAX_PARTS:
            raise UnreadableBodyError(f"The body has more than {MAX_PARTS} parts.")
        self.parts.append(Part())

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        self.parts[-1].content += memoryview(data)[start:end]

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._name += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_end(self) -> None:
        name = re.sub(r"[^a-z-]", "", self._name.decode("latin-1").lower())
        self.parts[-1].headers[name] = self._value.decode("latin-1")
        self._name = self._value = b""

    def _end(self) -> None:
        self.ended = True
