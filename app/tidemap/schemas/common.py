"""Forms that several messages share: strict bases, times in and out, pages, problems."""

import math
import re
from datetime import datetime, timezone
from typing import Annotated, Any, Generic, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$"
MAX_FIELDS = 100
FARTHEST_S = 6e10
"""Times lie within this many seconds of 1970, years 68 to 3871: every one of them can be written as ISO 8601."""


_DAY = r"\d{4}-?\d\d-?\d\d|\d{4}-?W\d\d(?:-?\d)?|\d{4}-\d\d"
_WITHOUT_HOUR = re.compile(rf"(?:{_DAY})(?:[Zz]|[+-]\d\d:?\d\d)?", re.ASCII)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_CALENDAR = re.compile(r"(?:19|20)\d\d(?:(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01]))?|[+-]?0\d+", re.ASCII)
"""A year, a day written without hyphens, or digits behind a zero as of a clock: nobody means them as Unix seconds."""
LIKE = "2026-03-01T09:00:00Z"


def parse_time(value: object) -> float:
    """Unix seconds of a number or an ISO 8601 string with a time of day and a zone.

    Raises ValueError for a number in quotes, a date alone, a naive time, NaN, infinity, a boolean, a time far from
    ours or anything else.

    >>> parse_time("1970-01-01T01:00:00+01:00"), parse_time(60)
    (0.0, 60.0)
    """
    if isinstance(value, str):
        return _parse_iso(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        # ValueError, not TypeError: that is what pydantic turns into a field's error.
        raise ValueError(f"give Unix seconds (a number) or an ISO 8601 time with a zone, such as {LIKE}")  # noqa: TRY004
    if value != value or value in (math.inf, -math.inf):
        raise ValueError("NaN and infinity are no times; give finite Unix seconds")
    if not -FARTHEST_S <= value <= FARTHEST_S:
        raise ValueError("this is no Unix time in seconds; check the unit")
    return float(value)


def parse_time_text(text: str) -> float:
    """As `parse_time`, where every value arrives as text, as in an address: numbers are Unix seconds.

    ValueError also for digits that read as a year, a day or a time of day; 2026.0 is Unix seconds.

    >>> parse_time_text("1700000000"), parse_time_text("2026.0"), parse_time_text("1970-01-01T00:01:00Z")
    (1700000000.0, 2026.0, 60.0)
    """
    if not _NUMBER.fullmatch(text):
        return _parse_iso(text)
    if _CALENDAR.fullmatch(text):
        raise ValueError(
            f"{text!r} reads as a date or a time of day; write a date in full, like {LIKE}, "
            "and Unix seconds without leading zeros and with a point, like 2026.0"
        )
    return parse_time(float(text))


def _parse_iso(text: str) -> float:
    if _NUMBER.fullmatch(text.strip()):
        raise ValueError(f"{text!r} is a number in quotes; give Unix seconds as a number, or a time like {LIKE}")
    if _WITHOUT_HOUR.fullmatch(text):
        raise ValueError(f"{text!r} is a date alone; add the time of day and a zone, as in {LIKE}")
    try:
        # Python 3.10 does not read the Z.
        moment = datetime.fromisoformat(f"{text[:-1]}+00:00" if text.endswith(("Z", "z")) else text)
    except ValueError:
        raise ValueError(f"{text!r} is no ISO 8601 time; write it like {LIKE}") from None
    if moment.tzinfo is None:
        raise ValueError(f"{text!r} has no time zone; append Z or an offset such as +01:00")
    return parse_time(moment.timestamp())


def iso(time_s: float) -> str:
    """ISO 8601 in UTC with a Z, to the microsecond at most.

    >>> iso(0), iso(1.5)
    ('1970-01-01T00:00:00Z', '1970-01-01T00:00:01.500000Z')
    """
    return datetime.fromtimestamp(time_s, timezone.utc).isoformat().replace("+00:00", "Z")


TIME_SCHEMA: dict[str, Any] = {
    "anyOf": [
        {"type": "number", "minimum": -FARTHEST_S, "maximum": FARTHEST_S},
        {"type": "string", "format": "date-time"},
    ],
    "description": "Unix seconds, or ISO 8601 with a zone.",
    "examples": [1772355600, "2026-03-01T09:00:00Z"],
}
TimeIn = Annotated[float, BeforeValidator(parse_time), WithJsonSchema(TIME_SCHEMA)]
TimeOut = Annotated[
    float,
    BeforeValidator(parse_time),
    PlainSerializer(iso, return_type=str),
    WithJsonSchema({"type": "string", "format": "date-time", "examples": ["2026-03-01T09:00:00Z"]}),
]


def storable(text: str) -> str:
    """The text itself. Raises ValueError for the one character that databases do not take.

    >>> storable("Flur 3")
    'Flur 3'
    """
    if "\0" in text:
        raise ValueError("it has a NUL character, which cannot be stored; leave it out")
    return text


Text = Annotated[str, AfterValidator(storable)]
Item = TypeVar("Item")
Many = Annotated[list[Item], Field(fail_fast=True)]
"""A list that a client sends. Only the first wrong item is named: a million may be wrong."""


class Form(BaseModel):
    """What a client sends: unknown fields, NaN, infinity, and true or "1" for a number are errors."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _few_fields(cls, value: Any) -> Any:
        """Each unknown field is an error, which takes a hundred times the memory of the field."""
        if isinstance(value, dict) and len(value) > MAX_FIELDS:
            raise ValueError(f"it has {len(value)} fields; known are {', '.join(cls.model_fields)}")
        return value


def shown(*examples: dict[str, Any]) -> ConfigDict:
    """Configuration of a form that shows these examples in the API's document."""
    return ConfigDict(json_schema_extra={"examples": list(examples)})


class Answer(BaseModel):
    """What the server sends; a client ignores fields it does not know."""

    model_config = ConfigDict(extra="ignore")


class Page(Answer, Generic[Item]):
    """One page of a list; `next` goes into `after` for the next page, null at the end."""

    items: list[Item]
    next: str | None = None


class ProblemField(Answer):
    """One offending field of a problem."""

    field: str
    message: str


class Problem(Answer):
    """An error as RFC 9457 has it."""

    type: str
    title: str
    status: int
    detail: str
    instance: str | None = None
    errors: list[ProblemField] | None = None
