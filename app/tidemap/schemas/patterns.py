"""Patterns: the locations that a key or a webhook is limited to, on the wire."""

from typing import Annotated

from pydantic import Field

PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,127}\*?$"
MAX_PATTERNS = 100
LocationPatterns = Annotated[
    list[Annotated[str, Field(pattern=PATTERN)]],
    Field(
        min_length=1,
        max_length=MAX_PATTERNS,
        description="Names of locations, or what their names begin with and a `*`; they need not exist yet.",
    ),
]
