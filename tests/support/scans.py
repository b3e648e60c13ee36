"""Scans as bodies."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.api.house import npy_file

NPY = "application/x-npy"


def files(header: Mapping[str, Any] | bytes, points: Any, media_type: str = NPY, part: str = "points") -> Any:
    """The parts of a scan as httpx sends them: arrays as npy, bytes as they are."""
    said = header if isinstance(header, bytes) else json.dumps(header).encode()
    content = npy_file(points) if isinstance(points, np.ndarray) else points
    return {"header": ("header", said, "application/json"), part: (part, content, media_type)}


def covariance(shift_m: float, rotation_deg: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(6, 6) of a pose with these standard deviations in each direction."""
    return np.diag(np.repeat([shift_m**2, np.radians(rotation_deg) ** 2], 3))
