"""What the viewer's page and its session say to each other, as JSON over one WebSocket."""

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from tidemap.schemas.common import Form, TimeIn
from tidemap.schemas.locations import Confidence
from tidemap_web.viewer.layers import LayoutName, ObservedName, PredictedName

MAX_STEPS = 65535
"""No grid is higher in steps."""
MAX_METRES = 1e7
Step = Annotated[int, Field(ge=0, le=MAX_STEPS)]
PageMessage = dict[str, Any]
"""Session to page, by `kind`; the newest of a kind replaces an unsent one. See `viewer.report`."""


class ViewRequest(Form):
    """What the page wants to see; a new one replaces the one before.

    Without `time`, or with `live`, the time of the newest observation; without `confidence`, the location's.
    `floor` hides what is less likely; `dim` takes the colour from what is always occupied. `crop` is the box that is
    shown, [i0, i1, j0, j1] of its first and last cells; `low` and `high` are its lowest and highest height, in grid
    steps. See `viewer.layers` for the rest.
    """

    kind: Literal["view"] = "view"
    location: str | None = Field(None, max_length=128)
    time: TimeIn | None = None
    live: bool = False
    confidence: Confidence | None = None
    order: int | None = Field(None, ge=0, le=64)
    floor: float = Field(0.1, ge=0, le=1)
    dim: bool = True
    low: Step | None = None
    high: Step | None = None
    crop: Annotated[list[Step], Field(min_length=4, max_length=4)] | None = None
    layout: LayoutName = "beside"
    predicted: PredictedName = "probability"
    observed: ObservedName = "seen"


class Aim(Form):
    """Put the camera at a standard view, or at a `pose`: where it is and what it looks at, in metres, and its vertical
    field of view in radians where that is not the usual one."""

    kind: Literal["aim"]
    view: Literal["slanted", "above", "pose"]
    pose: Annotated[list[Annotated[float, Field(ge=-MAX_METRES, le=MAX_METRES)]], Field(min_length=6, max_length=7)] = (
        Field(default=[0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    )


class Select(Form):
    """Select a cell by its linear index, or none."""

    kind: Literal["select"]
    cell: int | None = Field(None, ge=0)


Share = Annotated[float, Field(ge=0, le=1)]


class Hover(Form):
    """What is under the pointer, `at` shares of the scene's width and height from its top left?"""

    kind: Literal["hover"]
    at: Annotated[list[Share], Field(min_length=2, max_length=2)]


class Ping(Form):
    """Is somebody there? The answer is a `pong`."""

    kind: Literal["ping"]


Asked = ViewRequest | Aim | Select | Hover
"""What a session is asked."""
Request = Annotated[Asked | Ping, Field(discriminator="kind")]
_REQUEST: TypeAdapter[Asked | Ping] = TypeAdapter(Request)


def parse(text: str | bytes) -> Asked | Ping:
    """A message of the page. Raises ValueError (pydantic's ValidationError)."""
    return _REQUEST.validate_json(text)
