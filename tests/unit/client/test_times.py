"""Times a caller may give."""

from datetime import UTC, datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from tidemap.client.times import unix, unix_array


def test_datetimes_with_any_zone_become_unix_seconds() -> None:
    summer = datetime(2026, 7, 1, 9, 0, tzinfo=ZoneInfo("Europe/London"))
    assert unix(summer) == datetime(2026, 7, 1, 8, 0, tzinfo=UTC).timestamp()
    assert unix(datetime(1970, 1, 1, 2, tzinfo=timezone(timedelta(hours=2)))) == 0


def test_microseconds_survive() -> None:
    moment = datetime(2026, 7, 1, 9, 0, 0, 123456, tzinfo=UTC)
    assert unix(moment) == moment.timestamp()


def test_a_datetime_without_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="no time zone"):
        unix(datetime(2026, 7, 1))
    with pytest.raises(ValueError, match="no time zone"):
        unix_array(np.array(["2026-07-01"], "datetime64[s]"))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), True, "yesterday", "2026", "0930", "2026-07-01", None])
def test_what_is_no_time_is_refused(bad: object) -> None:
    with pytest.raises(ValueError, match=r"time|number"):
        unix(bad)  # type: ignore[arg-type]
    if bad is not True:  # numpy takes a boolean among numbers for a number
        with pytest.raises(ValueError, match=r"time|number"):
            unix_array([1.0, bad])  # type: ignore[list-item]


def test_lists_may_mix_the_forms() -> None:
    times = unix_array([0, 1.5, "1970-01-01T00:01:00Z", datetime(1970, 1, 2, tzinfo=UTC)])
    assert times.tolist() == [0, 1.5, 60, 86400]
    assert times.dtype == np.float64


def test_integers_of_numpy_and_large_epochs_are_exact() -> None:
    assert unix(np.int64(1_790_000_001)) == 1_790_000_001
    assert unix_array(np.array([1_790_000_001], np.int32)).item() == 1_790_000_001


def test_no_times_and_one_time() -> None:
    assert unix_array([]).shape == (0,)
    assert unix_array(5).shape == (1,)
    with pytest.raises(ValueError, match="one dimension"):
        unix_array(np.zeros((2, 2)))
