"""Scans as they are posted: read within the limits, with words for what is wrong."""

import numpy as np

from tidemap.api.forms import read_form
from tidemap.errors import InvalidInputError
from tidemap.formats import points
from tidemap.formats.scan_body import ScanBody
from tidemap.ingest.scan import SentScan
from tidemap.media_types import NPY
from tidemap.schemas.scans import RangesScan, ScanHeader

FAR = {"inf": np.inf, None: np.nan}


def read_scan(body: ScanBody) -> SentScan:
    """The scan in a body.

    Raises RequestValidationError, UnreadableBodyError, UnsupportedMediaTypeError, InvalidInputError.
    """
    parts = body.parts
    if parts.points is not None:
        header = read_form(bytes(parts.header), ScanHeader)
        return SentScan(header, points=points.read(parts.points.content, parts.points.media_type))
    if parts.ranges is not None:
        header = read_form(bytes(parts.header), ScanHeader)
        if parts.ranges.media_type != NPY:
            raise InvalidInputError.at("ranges", f"its Content-Type is {parts.ranges.media_type!r}; send {NPY}")
        return SentScan(header, ranges=points.read_numbers(parts.ranges.content, "ranges"))
    form = read_form(bytes(parts.header), RangesScan)
    ranges = np.array([value if isinstance(value, float | int) else FAR[value] for value in form.ranges], np.float64)
    return SentScan(form, ranges=ranges)
