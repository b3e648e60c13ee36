"""Civil time: what the clock on the wall of a time zone shows, as seconds that can be computed with."""

from datetime import datetime
from functools import lru_cache
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

MONDAY_S = 4 * 86_400.0
"""1970-01-05, a Monday, in seconds after 1970-01-01, both at midnight of the same clock."""

STEP_S = 900.0
"""Offsets from UTC change on whole quarters of an hour."""


def civil_seconds(time: NDArray[np.float64], time_zone: str) -> NDArray[np.float64]:
    """Seconds the local clock has counted from midnight of Monday, 5 January 1970; any shape.

    `time` is in Unix seconds, `time_zone` an IANA name (ZoneInfoNotFoundError if unknown). One
    look-up per quarter of an hour that occurs.

    >>> float(civil_seconds(np.array(1_717_200_000.0), "Europe/London") % 86_400)  # 2024-06-01 00:00Z
    3600.0
    """
    step, inverse = np.unique(np.floor(time / STEP_S), return_inverse=True)
    offset = np.array([_utc_offset_s(float(each) * STEP_S, time_zone) for each in step])
    return np.asarray(time + offset[inverse].reshape(time.shape) - MONDAY_S)


@lru_cache(maxsize=1 << 16)
def _utc_offset_s(time: float, time_zone: str) -> float:
    offset = datetime.fromtimestamp(time, ZoneInfo(time_zone)).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()
