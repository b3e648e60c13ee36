"""What the viewer's page and its session say to each other, as JSON over one WebSocket."""

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from tidemap.schemas.common import Form, TimeIn
from tidemap.schemas.locations import Confidence

PageMessage = dict[str, Any]
"""Session to page: `kind`: grids, location, frame, notice, selected; the newest of a kind replaces an unsent one."""


class ViewRequest(Form):
    """What the page wants to see; a new one replaces the one before.

    Without `time`, or with `live`, the time of the newest observation; without `confidence`, the location's.
    `floor` hides what is less likely; `dim` takes the colour from what is always occupied.
    """

    kind: Literal["view"] = "view"
    location: str | None = Field(None, max_length=128)
    time: TimeIn | None = None
    live: bool = False
    confidence: Confidence | None = None
    order: int | None = Field(None, ge=0, le=64)
    floor: float = Field(0.1, ge=0, le=1)
    dim: bool = True


class Aim(Form):
    """Turn the camera to a standard view."""

    kind: Literal["aim"]
    view: Literal["slanted", "above"]


class Select(Form):
    """Select a cell by its linear index, or none."""

    kind: Literal["select"]
    cell: int | None = Field(None, ge=0)


Request = Annotated[ViewRequest | Aim | Select, Field(discriminator="kind")]
_REQUEST: TypeAdapter[ViewRequest | Aim | Select] = TypeAdapter(Request)


def parse(text: str | bytes) -> ViewRequest | Aim | Select:
    """A message of the page. Raises ValueError (pydantic's ValidationError)."""
    return _REQUEST.validate_json(text)
