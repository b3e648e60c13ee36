"""Import from end to end: read everything, find or make the location, post."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any

import numpy as np

from tidemap.client import Client, LocationHandle, TidemapError
from tidemap.errors import UnusableFileError
from tidemap.importing.files import digest_of, naming
from tidemap.importing.opening import open_files
from tidemap.importing.options import ImportOptions
from tidemap.importing.posting import Tally, post_snapshots
from tidemap.importing.proposal import propose
from tidemap.importing.records import ImportSource, Missing
from tidemap.importing.snapshots import SnapshotColumns, snapshot_of
from tidemap.importing.survey import Findings, corner_text, survey
from tidemap.progress import Progress, Step
from tidemap.schemas.locations import Location
from tidemap.space.grid import SINGLE, GridGeometry

MAX_COARSER = 1 + 1e-6
"""How much larger the cells of a map may be, by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """What was found; the settings of a location for it, or why there are none; why it cannot be imported as it is."""

    sources: Sequence[ImportSource]
    found: Sequence[Findings]
    proposal: dict[str, Any] | None
    problems: Sequence[str]


def survey_files(paths: Sequence[Path], options: ImportOptions, progress: Progress) -> Report:
    """Read all files; nothing is posted. Raises UnusableFileError."""
    sources = open_files(paths, options)
    with progress.task("Reading", 0) as step:
        found = survey(sources, step)
    problems = [*_problems(found, options), *_choices(sources, options)]
    try:
        proposal = propose(found, options)
    except ValueError as error:
        return Report(sources, found, None, [*problems, str(error)])
    return Report(sources, found, proposal, problems)


def _problems(found: Sequence[Findings], options: ImportOptions) -> Iterator[str]:
    for each in found:
        if each.missing and not options.skip_missing:
            yield (
                f"{each.path}: {each.what}: {each.missing} of {each.n_all} cannot be used: {each.reason}. "
                "Or leave them out with --skip-missing"
            )
        if not each.measurements:
            yield f"{each.path}: {each.what}: there is nothing in it to import"


def _choices(sources: Sequence[ImportSource], options: ImportOptions) -> Iterator[str]:
    for path, n in Counter(each.path for each in sources).items():
        if n > 1 and not options.topics:
            names = ", ".join(each.what for each in sources if each.path == path)
            yield f"{path}: it has several topics to import: {names}. Choose some with --topic"


def import_files(
    report: Report, options: ImportOptions, client: Client, location: str, create: bool, progress: Progress
) -> Tally:
    """Post what was found. Raises UnusableFileError, with nothing stored, and TidemapError."""
    if report.problems:
        raise UnusableFileError("Nothing was imported", "; ".join(report.problems))
    handle = client.location(location)
    known = _known(handle, report.proposal if create else None, client)
    if misfits := [why for each in report.found if (why := _misfit(each, known, options)) is not None]:
        raise UnusableFileError("Nothing was imported", "; ".join(misfits))
    tally = Tally()
    with progress.task("Posting", sum(each.records for each in report.found)) as step:
        for source in report.sources:
            post_snapshots(handle, digest_of(source.path), _snapshots(source, _geometry(known), options, step), tally)
    return tally


def _misfit(found: Findings, location: Location, options: ImportOptions) -> str | None:
    """Why something does not fit into a location, None where it does."""
    grid, what = location.grid, f"{found.path}: {found.what}"
    if grid is None:
        return f"{what} has cells in space; name a location with a grid" if found.kind == "grid" else None
    if found.kind == "state":
        return f"{what} has states of one thing; name a location of kind 'state'"
    if options.fixed_frame.lstrip("/") != grid.frame.lstrip("/"):
        return (
            f"{what} is put into the frame {options.fixed_frame!r}, and the location is in {grid.frame!r}; "
            f"say --fixed-frame {grid.frame}"
        )
    if found.coarsest_m > grid.resolution_m * MAX_COARSER:
        return (
            f"{what} has cells of {found.coarsest_m} m, larger than those of the location, {grid.resolution_m} m; "
            "make a location with cells as large"
        )
    return _outside(found, _geometry(location), what)


def _outside(found: Findings, grid: GridGeometry, what: str) -> str | None:
    """That all that was seen is outside of a grid, None where it is not."""
    low = np.array(grid.origin)
    high = low + np.array(grid.shape3) * grid.resolution_m
    axes = slice(2 if grid.shape3[2] == 1 else 3)
    if ((found.high >= low) & (found.low <= high))[axes].all():
        return None
    reach, extent = (f"{corner_text(a)} to {corner_text(b)}" for a, b in ((found.low, found.high), (low, high)))
    return f"{what} reaches from {reach} m, and the location from {extent}: nothing of it is inside. Check the frames"


def _known(handle: LocationHandle, proposal: dict[str, Any] | None, client: Client) -> Location:
    """The location, made as proposed where it is not there; one that is there stays as it is."""
    try:
        return handle.get()
    except TidemapError as error:
        if error.status != HTTPStatus.NOT_FOUND or proposal is None:
            raise
    client.create_location(handle.name, **proposal)
    return handle.get()


def _geometry(location: Location) -> GridGeometry:
    grid = location.grid
    return SINGLE if grid is None else GridGeometry(grid.frame, grid.origin, grid.resolution_m, tuple(grid.shape))


def _snapshots(
    source: ImportSource, grid: GridGeometry, options: ImportOptions, step: Step
) -> Iterator[SnapshotColumns]:
    with naming(source.path):
        for record in source.records():
            if isinstance(record, Missing):
                continue
            snapshot = snapshot_of(record, grid, options.min_hits)
            step(1)
            if len(snapshot):
                yield snapshot
