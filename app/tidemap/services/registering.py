"""Registering: where a scan stands in the map of its location, and what it saw from there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tidemap.errors import InvalidInputError, NoModelError
from tidemap.history.measurements import Measurements
from tidemap.ingest.observation import check_time
from tidemap.ingest.registration import RegistrationMode, RegistrationOutcome, as_stated, register
from tidemap.ingest.scan import SentScan, refuse_outside, scan_of
from tidemap.services.context import Context
from tidemap.services.observe import target_of
from tidemap.services.parts import BoxPart
from tidemap.services.spectra import Fitted, fitted
from tidemap.services.surfaces import Block, surface_at
from tidemap.space.grid import GridGeometry
from tidemap.space.scan import Scan
from tidemap.storage.records import LocationRecord


@dataclass(frozen=True, slots=True, eq=False)
class TimedScan:
    """A scan at a time (Unix seconds), and whether it is to be registered."""

    time: float
    scan: Scan
    mode: RegistrationMode


@dataclass(frozen=True, slots=True, eq=False)
class RegisteredScan:
    """A sweep with its registration, and what it saw: one snapshot, whose cells ascend; nothing in quarantine."""

    location: LocationRecord
    sweep: TimedScan
    registration: RegistrationOutcome
    seen: Measurements

    @property
    def quarantined(self) -> bool:
        """Whether its place in the map is not known."""
        return self.registration.verdict == "quarantined"


def timed_scan(location: LocationRecord, sent: SentScan) -> TimedScan:
    """What was sent, for the grid of a location. Raises InvalidInputError."""
    scan = scan_of(sent, _grid(location))
    return TimedScan(sent.header.time, scan, sent.header.registration)


def register_scan(ctx: Context, location: LocationRecord, sweep: TimedScan) -> RegisteredScan:
    """Register a sweep by what is expected at its time, and cast its rays. Raises InvalidInputError."""
    grid = _grid(location)
    check_time(sweep.time, target_of(ctx, location))
    refuse_outside(sweep.scan, grid)
    registration = _registered(ctx, location, sweep)
    if registration.verdict == "quarantined":
        return RegisteredScan(location, sweep, registration, _snapshot(sweep.time, *np.zeros((2, 0), np.int64)))
    seen = sweep.scan.at(registration.map_from_sensor).cast(grid)
    if not len(seen.cell):
        raise InvalidInputError.at(
            "map_from_sensor", "no ray crosses the grid or ends in it; check the pose and that lengths are metres"
        )
    return RegisteredScan(location, sweep, registration, _snapshot(sweep.time, seen.cell, seen.state))


def _grid(location: LocationRecord) -> GridGeometry:
    if location.grid is None:
        raise InvalidInputError.at(
            "body", f"location {location.name!r} is of kind 'state' and has no grid; post its states as observations"
        )
    return location.grid


def _registered(ctx: Context, location: LocationRecord, sweep: TimedScan) -> RegistrationOutcome:
    """Where a sweep stands in the map, as far as that can be known."""
    if sweep.mode == "never":
        return as_stated(sweep.scan, "registration was not wanted")
    if sweep.mode == "auto" and sweep.scan.covariance is None:
        return as_stated(sweep.scan, "no covariance says how wrong the pose may be")
    block = Block.of(sweep.scan, location.cells)
    model = _model(ctx, location, block)
    if model is None:
        return as_stated(sweep.scan, "the location has no model yet to register it by")
    return register(sweep.scan, surface_at(ctx, model, block, sweep.time))


def _model(ctx: Context, location: LocationRecord, block: Block) -> Fitted | None:
    try:
        return fitted(ctx, location.name, part=BoxPart(block.bbox))
    except NoModelError:
        return None


def _snapshot(time: float, cell: NDArray[np.integer], state: NDArray[np.integer]) -> Measurements:
    once = np.broadcast_to(np.float64(time), len(cell))
    return Measurements(once, cell.astype(np.uint32, copy=False), state.astype(np.uint8, copy=False))
