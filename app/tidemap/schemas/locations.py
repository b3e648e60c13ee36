"""Locations on the wire."""

import math
from typing import Annotated, Literal
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Strict, Tag, model_validator
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


class SensorRates(Form):
    """How often a sensor errs: the share of occupied states that it misses, and of free ones that it reports."""

    miss: float = Field(ge=0, lt=0.5, examples=[0.1])
    false_alarm: float = Field(ge=0, lt=0.5, examples=[0.02])


# The tags are no identifiers: errors do not name them.
SensorChoice = Annotated[
    Annotated[SensorRates, Tag("the rates")] | Annotated[Literal["learn"], Tag("the word")],
    Discriminator(lambda value: "the word" if isinstance(value, str) else "the rates"),
]
SENSOR = (
    "How often the sensor errs: `miss`, the share of occupied states that it reads as free, and `false_alarm`, the "
    "share of free ones that it reads as occupied; or `learn`, for updates to learn both from the history. Every "
    "reading then moves a belief, and answers that are given observations are conditioned on it. Without a sensor "
    "readings are true."
)


EVENT_GAP = (
    "How many seconds without a surprise an event outlasts: what is surprising sooner continues it, what is later "
    "begins another. By default two samples."
)
GapSeconds = Annotated[float, Field(ge=0, le=FARTHEST_S)]


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

    def cells(self, points: ArrayLike) -> NDArray[np.int64]:
        """The linear cells (n,) that points (n, 2 or 3), in metres in `frame`, are in; -1 outside of the grid.

        A grid of one layer leaves z out.

        >>> Grid(resolution_m=0.5, shape=[4, 3]).cells([[0.7, 0.1], [1.9, 1.4], [-0.1, 0.0]]).tolist()
        [3, 11, -1]
        """
        array = np.asarray(points, np.float64)
        used = 2 if len(self.shape) == 2 or self.shape[2] == 1 else 3
        if array.ndim != 2 or not used <= array.shape[1] <= 3:
            raise ValueError(f"points are an array (n, {used}); this has the shape {array.shape}")
        index = np.floor((array[:, :used] - np.array(self.origin[:used])) / self.resolution_m)
        inside = ((index >= 0) & (index < self.shape[:used])).all(axis=1)
        found = np.full(len(array), -1, np.int64)
        found[inside] = np.ravel_multi_index(tuple(index[inside].astype(np.int64).T), tuple(self.shape[:used]))
        return found


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
    min_cells: MinCells = Field(1, description="Events of fewer neighbouring cells at a time are not reported.")
    event_gap_s: GapSeconds | None = Field(None, description=EVENT_GAP)
    sensor: SensorChoice | None = Field(None, description=SENSOR)
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
    sensor: SensorChoice | None = Field(None, description=f"{SENSOR} Null takes it away.")
    event_gap_s: GapSeconds | None = None
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
    sensor: SensorChoice | None = None
    event_gap_s: float | None = None
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
