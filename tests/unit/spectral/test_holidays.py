"""Public holidays: a location with a calendar lives them as Sundays, in fitting, predicting and reconstruction."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.auto.selection import choose
from tidemap.spectral.civil import MONDAY_S, SUNDAY, civil_seconds, knows_calendar, week_seconds, weekdays
from tidemap.spectral.estimators import fit_recipe
from tidemap.spectral.prediction import predict_slow, predict_times
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.reconstruction import predicted_words
from tidemap.spectral.spectrum import Spectrum, concatenate, select, truncate
from tidemap.storage.blobs import pack_spectrum, unpack_spectrum

LONDON = "Europe/London"
ENGLAND = "GB-ENG"
DAY_S = 86_400
MARCH = datetime(2024, 3, 4, tzinfo=UTC).timestamp()
"""A Monday; Good Friday is the 29th, Easter Monday 1 April, bank holidays are 6 and 27 May and 26 August."""
MAY_27 = datetime(2024, 5, 27, 11, tzinfo=UTC).timestamp()
AUGUST_26 = datetime(2024, 8, 26, 11, tzinfo=UTC).timestamp()


def office(base: TimeBase, days: int) -> NDArray[np.uint8]:
    """Open from 9 to 17 on working days, (1, n): closed on weekends and holidays."""
    time = base.time(np.arange(round(days * DAY_S / base.interval_s)))
    seconds = week_seconds(time, LONDON, ENGLAND)
    hour, weekday = seconds % DAY_S / 3600, seconds // DAY_S % 7
    return ((hour >= 9) & (hour < 17) & (weekday < 5)).astype(np.uint8)[np.newaxis]


def fitted(calendar: str | None, interval_s: float = 900.0, days: int = 80) -> Spectrum:
    base = TimeBase(MARCH, interval_s)
    return fit_recipe(History.from_states(office(base, days)), Recipe("calendar", 40, LONDON, calendar=calendar), base)


def test_a_holiday_that_is_to_come_is_predicted_as_a_sunday() -> None:
    at = [MAY_27, MAY_27 + DAY_S, AUGUST_26, AUGUST_26 + DAY_S]
    assert np.all(predict_times(fitted(None), at)[0] > 0.8)
    monday, tuesday, august, after = predict_times(fitted(ENGLAND), at)[0]
    assert max(monday, august) < 0.1 < 0.9 < min(tuesday, after)


def test_holidays_that_were_closed_do_not_blur_the_working_days() -> None:
    with_calendar, without = (predict_times(fitted(name), [MAY_27 + 7 * DAY_S])[0, 0] for name in (ENGLAND, None))
    assert with_calendar > without


@given(st.integers(0, 500), st.floats(0, DAY_S, exclude_max=True))
def test_the_day_decides_alone(day: int, second: float) -> None:
    local = np.array([MARCH + day * DAY_S + second])
    seconds, plain = week_seconds(local, LONDON, ENGLAND), civil_seconds(local, LONDON)
    assert seconds % DAY_S == plain % DAY_S
    assert seconds // (7 * DAY_S) == plain // (7 * DAY_S)
    number = (plain // DAY_S).astype(np.int64)
    assert seconds // DAY_S % 7 == weekdays(number, ENGLAND)


@pytest.mark.parametrize("interval_s", [60.0, 900.0, 1800.0, 3600.0, 7200.0, 86_400.0, 700.0])
def test_reconstruction_thresholds_what_is_predicted(interval_s: float) -> None:
    spectrum = fitted(ENGLAND, max(interval_s, 900.0), 60)
    base = TimeBase(MARCH, interval_s)
    spectrum = replace(spectrum, base=base)
    n = int(min(60 * DAY_S // interval_s, 20_000))
    start = int(20 * DAY_S // interval_s)
    words = predicted_words(spectrum, base, start, start + n)
    bits = np.unpackbits(words.view(np.uint8), axis=1, bitorder="little")[0, start % 64 : start % 64 + n]
    p = predict_slow(spectrum, base.time(np.arange(start, start + n)))[0]
    clear = np.abs(p - 0.5) > 1e-4
    assert np.array_equal(bits[clear], (p > 0.5)[clear])


def test_the_calendar_stays_with_the_spectrum() -> None:
    spectrum = fitted(ENGLAND)
    stored = unpack_spectrum(pack_spectrum(spectrum), "a spectrum", spectrum.base)
    for each in (stored, truncate(spectrum, 0), truncate(spectrum, 3), select(spectrum, [0]), concatenate([spectrum])):
        assert each.calendar == ENGLAND
    with pytest.raises(ValueError, match="calendar"):
        concatenate([spectrum, fitted(None)])


def test_selection_lives_by_the_calendar() -> None:
    base = TimeBase(MARCH, 900.0)
    history = History.from_states(office(base, 84))
    plain = choose(history, base, time_zone=LONDON)
    known = choose(history, base, time_zone=LONDON, calendar=ENGLAND)
    assert known.recipe.calendar == ENGLAND
    assert min(row.log_loss for row in known.table) < min(row.log_loss for row in plain.table)
    assert Recipe.from_dict(known.recipe.as_dict()) == known.recipe


@pytest.mark.parametrize(
    ("code", "known"),
    [("GB", True), ("GB-ENG", True), ("DE-BY", True), ("XX", False), ("GB-XX", False), ("", False), ("gb", False)],
)
def test_codes(code: str, known: bool) -> None:
    assert knows_calendar(code) is known


def test_threads_agree_on_a_year_that_nobody_asked_about_yet() -> None:
    christmas = np.array([(datetime(2031, 12, 25, tzinfo=UTC).timestamp() - MONDAY_S) // DAY_S], np.int64)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as pool:
            for calendar in ("GB", "DE", "FR", "IT", "ES", "PL", "CZ", "AT"):
                found = [pool.submit(weekdays, christmas, calendar) for _ in range(4)]
                assert [int(each.result()[0]) for each in found] == [SUNDAY] * 4
    finally:
        sys.setswitchinterval(interval)
