"""Times a caller may give, as Unix seconds."""

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tidemap.schemas.common import parse_time


class StampLike(Protocol):
    """Shaped like builtin_interfaces/Time: seconds and nanoseconds since 1970."""

    @property
    def sec(self) -> int:
        """Whole seconds."""

    @property
    def nanosec(self) -> int:
        """And nanoseconds."""


TimeLike: TypeAlias = float | int | str | datetime | np.number[Any] | StampLike
TimesLike: TypeAlias = TimeLike | Sequence[TimeLike] | NDArray[Any]


def unix(time: TimeLike) -> float:
    """Unix seconds of a number, an ISO 8601 text with a zone, a datetime with a zone, or a stamp of ROS.

    Raises ValueError for a time without a zone, NaN, infinity and float32, which rounds to minutes.

    >>> from datetime import datetime, timezone
    >>> unix(datetime(1970, 1, 2, tzinfo=timezone.utc)), unix("1970-01-01T01:00:00+01:00"), unix(7)
    (86400.0, 0.0, 7.0)
    """
    if isinstance(time, datetime):
        return parse_time(time.isoformat())
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return parse_time(time.sec + time.nanosec * 1e-9)
    if isinstance(time, np.generic):
        return unix_array(np.asarray(time)).item()
    return parse_time(time)


def is_single(times: TimesLike) -> bool:
    """Whether it is one time and no list of times.

    >>> is_single(5), is_single("1970-01-01T00:00:00Z"), is_single(np.float64(5)), is_single([5])
    (True, True, True, False)
    """
    return isinstance(times, str) or getattr(times, "ndim", None) == 0 or not hasattr(times, "__len__")


def unix_array(times: TimesLike) -> NDArray[np.float64]:
    """Unix seconds (n,) of one time or many; numbers are taken as they are, one check for all.

    >>> unix_array([0, "1970-01-01T00:01:00Z"]).tolist(), unix_array(5).tolist()
    ([0.0, 60.0], [5.0])
    """
    if isinstance(times, str | datetime):
        return np.array([unix(times)])
    array = np.atleast_1d(np.asarray(times))
    if array.ndim != 1:
        raise ValueError(f"times have one dimension; these have the shape {array.shape}")
    if array.dtype.kind == "f" and array.dtype.itemsize < np.float64().itemsize:
        raise ValueError(f"{array.dtype} is too coarse for Unix seconds, minutes off; give float64, or integers")
    if array.size == 0 or array.dtype.kind in "fiu":
        return _finite(array.astype(np.float64))
    if array.dtype.kind == "M":
        raise ValueError("numpy datetime64 has no time zone; give Unix seconds or datetimes with a zone")
    return np.array([unix(time) for time in np.atleast_1d(np.asarray(times, dtype=object))])


def _finite(array: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(array).all():
        raise ValueError("NaN and infinity are no times; give finite Unix seconds")
    return array
