"""Locations on the wire."""

import math
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, BeforeValidator, Field, Strict, model_validator
from pydantic.json_schema import SkipJsonSchema

from tidemap.schemas.common import FARTHEST_S, NAME_PATTERN, Answer, Form, Many, Text, TimeIn, TimeOut, shown

Kind = Literal["state", "grid2d", "grid3d"]
EstimatorName = Literal["calendar", "fft", "static"]
EstimatorChoice = Literal["auto", "calendar", "fft", "static"]
Order = Annotated[int, Field(ge=1, le=64)]
OrderChoice = Order | Literal["auto"]
Confidence = Annotated[float, Field(ge=0.5, lt=1)]
Missing = Literal["mask", "hold"]
Combine = Literal["latest", "any", "majority"]
Seconds = Annotated[float, Field(gt=0, le=FARTHEST_S)]
MAX_INT32 = 2**31 - 1
"""What a database holds in an integer."""
MinCells = Annotated[int, Field(ge=1, le=MAX_INT32)]
Metres = Annotated[float, Strict()]


COMBINE = (
    "What several measurements of a cell in one sample make of it: `latest`, the state of the last one; `any`, "
    "occupied where one of them is; `majority`, occupied where half of them are. It cannot be changed once there are "
    "observations."
)


def _fixed(_: object) -> None:
    raise ValueError("this cannot be changed later; make a new location instead")


Fixed = Annotated[SkipJsonSchema[None], BeforeValidator(_fixed)]
"""What a location keeps as it was made: sending it is an error that says so."""


def _known_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError, TypeError):
        raise ValueError(f"{name!r} is no IANA time zone; use a name such as Europe/London or UTC") from None
    return name


CalendarCode = Annotated[str, Field(pattern=r"^[A-Z]{2}(-[A-Z0-9]{1,3})?$", examples=["GB", "DE-BY"])]
CALENDAR = (
    "ISO 3166 code of a country (`GB`) or of a part of one (`GB-ENG`): its public holidays count as Sundays in models "
    "of the estimator `calendar`."
)
TimeZone = Annotated[str, AfterValidator(_known_zone), Field(examples=["Europe/London"])]


class Grid(Form):
    """A regular grid: `origin` is the corner of cell [0,0,0] in `frame`, in metres."""

    frame: Text = Field("map", min_length=1, max_length=128)
    origin: Annotated[tuple[Metres, Metres, Metres], Strict(False)] = (0.0, 0.0, 0.0)
    resolution_m: float = Field(gt=0, le=1000)
    shape: Many[Annotated[int, Field(ge=1, le=65536)]] = Field(min_length=2, max_length=3)

    @property
    def n_cells(self) -> int:
        """How many cells the grid has."""
        return math.prod(self.shape)


class Position(Form):
    """Where a location stands in a frame, in metres: a door or a room in the map of its building."""

    frame: Text = Field("map", min_length=1, max_length=128)
    position: Annotated[tuple[Metres, Metres, Metres], Strict(False)]


class LocationForm(Form):
    """A new location."""

    model_config = shown(
        {"name": "office-door", "kind": "state", "interval_s": 60, "time_zone": "Europe/London"},
        {
            "name": "lab",
            "kind": "grid3d",
            "interval_s": 300,
            "grid": {"frame": "map", "origin": [0, 0, 0], "resolution_m": 0.2, "shape": [60, 40, 12]},
            "confidence": 0.9,
        },
    )

    name: str = Field(pattern=NAME_PATTERN, examples=["office-door"])
    kind: Kind = "state"
    interval_s: float = Field(ge=0.001, le=31 * 86400, description="Length of a sample in seconds.", examples=[60])
    time_zone: TimeZone = "UTC"
    epoch: TimeIn = Field(0.0, description="Start of sample 0.")
    grid: Grid | None = None
    estimator: EstimatorChoice = "auto"
    order: OrderChoice = "auto"
    confidence: Confidence = 0.9
    missing: Missing = "mask"
    hold_s: Seconds | None = Field(None, description="How long a state stands at most, for `hold`.")
    combine: Combine = Field("latest", description=COMBINE)
    retention: Seconds | None = Field(
        None, description="Forget what is older than this many seconds by the server's clock; posts of it are dropped."
    )
    min_cells: MinCells = Field(1, description="Events of fewer neighbouring cells are not reported.")
    calendar: CalendarCode | None = Field(None, description=CALENDAR)
    pose: Position | None = Field(None, description="Where it stands in the map of its building.")

    @model_validator(mode="after")
    def _consistent(self) -> "LocationForm":
        if self.kind == "state" and self.grid is not None:
            raise ValueError("a location of kind 'state' has one cell and no grid; leave `grid` out or change `kind`")
        if self.kind != "state" and self.grid is None:
            raise ValueError(f"a location of kind {self.kind!r} needs `grid` with resolution_m and shape")
        if self.grid is not None:
            self._check_shape(self.grid)
        if self.missing == "hold" and self.hold_s is None:
            raise ValueError("`missing` = 'hold' needs `hold_s`, the seconds a state stands at most")
        return self

    def _check_shape(self, grid: Grid) -> None:
        flat = len(grid.shape) == 2 or grid.shape[2] == 1
        if self.kind == "grid2d" and not flat:
            raise ValueError("grid.shape of a grid2d is [nx, ny]; for several layers use kind 'grid3d'")
        if self.kind == "grid3d" and len(grid.shape) != 3:
            raise ValueError("grid.shape of a grid3d is [nx, ny, nz]")


class LocationPatch(Form):
    """What may be changed later; the time base and the grid stay as they are."""

    model_config = shown({"name": "front-door", "confidence": 0.95})

    name: str | None = Field(None, pattern=NAME_PATTERN)
    time_zone: TimeZone | None = None
    estimator: EstimatorChoice | None = None
    order: OrderChoice | None = None
    confidence: Confidence | None = None
    missing: Missing | None = None
    hold_s: Seconds | None = None
    combine: Combine | None = None
    retention: Seconds | None = None
    min_cells: MinCells | None = None
    calendar: CalendarCode | None = None
    pose: Position | None = None

    kind: Fixed = None
    interval_s: Fixed = None
    epoch: Fixed = None
    grid: Fixed = None


class Location(Answer):
    """A location with what is known of it. `observations` counts measurements."""

    name: str
    kind: Kind
    interval_s: float
    time_zone: str
    epoch: TimeOut
    grid: Grid | None
    shape: list[int]
    estimator: EstimatorChoice
    order: OrderChoice
    confidence: float
    missing: Missing
    hold_s: float | None
    combine: Combine = "latest"
    retention: float | None
    min_cells: int
    calendar: str | None = None
    pose: Position | None = None
    created_at: TimeOut
    observations: int
    first_time: TimeOut | None
    last_time: TimeOut | None
    revision: int
    updated_at: TimeOut | None
    accuracy: float | None
    open_anomalies: int
