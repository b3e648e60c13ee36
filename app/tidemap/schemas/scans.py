"""Scans on the wire: what is said of one beside its points, and what became of it."""

from typing import Annotated, Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Many, Text, TimeIn, TimeOut, shown
from tidemap.schemas.observations import Accepted

Verdict = Literal["accepted", "raw_pose", "quarantined"]
RegistrationMode = Literal["auto", "always", "never"]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
MAX_RAYS = 100_000
"""Rays of a scan that is sent as ranges; planar lasers have some 1,000."""
POSE = (
    "The transform that takes points of the sensor's frame into the map's: [x, y, z, qx, qy, qz, qw] in metres, "
    "or a 4x4 matrix by rows."
)
COVARIANCE = (
    "6x6, by rows, of x, y, z (m) and the rotations about the map's x, y, z (rad), as in geometry_msgs: how wrong the "
    "pose may be. Without it a scan is not registered."
)


class ScanHeader(Form):
    """What is said of a scan beside its points."""

    model_config = shown(
        {
            "time": "2026-03-01T09:00:00Z",
            "map_from_sensor": [11.0, 21.0, 0.5, 0.0, 0.0, 0.0, 1.0],
            "max_range": 30.0,
        }
    )

    time: TimeIn
    map_from_sensor: Many[Number | Many[Number]] = Field(min_length=4, max_length=7, description=POSE)
    frame: Text | None = Field(None, max_length=128, description="The map's frame; if given, it is the grid's.")
    covariance: Many[Many[Number]] | None = Field(None, min_length=6, max_length=6, description=COVARIANCE)
    max_range: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description="Points further than this (m) clear the cells up to there and hit none; at most `range_max`.",
    )
    min_hits: int = Field(1, ge=1, le=100, description="Hits from which on a cell is occupied.")
    registration: RegistrationMode = Field(
        "auto", description="Align the scan to the map: where there is a covariance, in any case, or not at all."
    )
    angle_min: Number | None = Field(None, description="Angle of the first ray, rad; for `ranges`.")
    angle_increment: Number | None = Field(None, description="Angle between two rays, rad; for `ranges`.")
    angles: Many[Number] | None = Field(
        None, min_length=1, max_length=MAX_RAYS, description="Or the angle of each ray, rad, about the sensor's z."
    )
    range_min: float | None = Field(None, ge=0, le=1e6, description="Shorter ranges are left out.")
    range_max: float | None = Field(
        None, gt=0, le=1e6, description="Longer ranges are left out; infinity clears up to here."
    )


class RangesScan(ScanHeader):
    """A scan of a planar laser, with its ranges: null for none measured, "inf" for nothing met up to `max_range`."""

    model_config = shown(
        {
            "time": "2026-03-01T09:00:00Z",
            "map_from_sensor": [11.0, 21.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            "angle_min": -0.5,
            "angle_increment": 0.5,
            "ranges": [0.9, "inf", None],
            "range_max": 10.0,
        }
    )

    ranges: Many[float | Literal["inf"] | None] = Field(min_length=1, max_length=MAX_RAYS)


class Correction(Answer):
    """What registration added to the stated pose, in the map's axes."""

    translation_m: list[float]
    rotation_rad: list[float] = Field(description="A rotation vector.")


class ScanFeatures(Answer):
    """What a verdict rests on; docs/sensors.md explains the numbers."""

    converged: bool
    weakest: float
    inliers: int
    sigmas: float
    disagreement_m: float
    disagreement_rad: float


class Registration(Answer):
    """A verdict and its reason. `correction` and `features` are null where nothing was aligned."""

    verdict: Verdict
    reason: str
    map_from_sensor: list[float] = Field(description="The pose that stands: [x, y, z, qx, qy, qz, qw].")
    correction: Correction | None = None
    features: ScanFeatures | None = None


class ScanAccepted(Accepted):
    """The answer to a scan, sent after the durable commit."""

    scan: int | None = Field(None, description="Its id; null of a duplicate that is not listed any more.")
    registration: Registration | None = None


class ScanItem(Answer):
    """A scan with its verdict. `points` can be had and registered again as long as it is quarantined."""

    id: int
    time: TimeOut
    received_at: TimeOut
    source: str | None
    points: int
    bytes: int = Field(description="Bytes that its kept points take, packed or not, whichever is more.")
    observation: int | None = Field(description="The number of the observation that it became.")
    registration: Registration
