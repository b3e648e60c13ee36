"""Buffers: what is written again and again is, byte for byte, what would be sent if it were made anew."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.contexts import make_location, opened, post_rows, refit
from tidemap.formats import arrow
from tidemap.formats.table import Labels, Nullable
from tidemap.history.history import UNOBSERVED
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Context
from tidemap.services.locations import LocationChanges, change_location
from tidemap.services.state import Asked, BufferedState, StateQuery, StateView, ask, buffer_of, state_at
from tidemap.services.state_buffer import StateBuffer
from tidemap.services.warm import warm
from tidemap.spectral import belief, conditioning, kernels
from tidemap.spectral.prediction import VERDICTS
from tidemap.spectral.sensor import Sensor
from tidemap.spectral.spectrum import Spectrum, blank

FACTS = {"time": "2026-03-02T09:30:00Z", "revision": 3}


def rhythmic_lab(ctx: Context) -> None:
    """A grid of two chunks; a few cells are occupied in the first half of every twenty minutes, one always."""
    make_location(ctx, "lab", (40, 40), confidence=0.8)
    rows = [(60.0 * n, cell, int(n % 20 < 10)) for n in range(200) for cell in (3, 700, 1030)]
    post_rows(ctx, "lab", rows + [(60.0 * n, 1599, 1) for n in range(200)])
    refit(ctx, "lab", estimator="fft", order=2)


def as_sent(ctx: Context, query: StateQuery) -> bytes:
    """The answer of a buffer, whole."""
    return whole(buffered(ctx, ask(ctx, "lab", query)))


def buffered(ctx: Context, asked: Asked) -> BufferedState:
    """The answer of a buffer."""
    answer = buffer_of(ctx, asked)
    assert answer is not None
    return answer


def whole(answer: BufferedState) -> bytes:
    """What is sent of it, but for its facts."""
    return answer.lease.value.arrow.head(FACTS) + answer.lease.memory.tobytes()


def made_anew(view: StateView) -> bytes:
    columns: dict[str, Any] = {
        "cell": view.cell.astype(np.uint32),
        "probability": view.probability,
        "state": view.state,
        "verdict": Labels(view.verdict, VERDICTS),
    }
    if view.observed is not None and view.observed_time is not None:
        columns["observed"] = Nullable(view.observed, view.observed == UNOBSERVED)
        columns["observed_time"] = Nullable(view.observed_time, np.isnan(view.observed_time))
    return bytes(arrow.write(FACTS, columns))


@pytest.mark.parametrize("how", [{}, {"confidence": 0.55}, {"order": 1}, {"estimator": "static"}])
def test_a_buffer_is_what_would_be_made_anew(ctx: Context, how: dict[str, Any]) -> None:
    rhythmic_lab(ctx)
    for n in (1003, 1013, 1003, 4):
        query = StateQuery(60.0 * n, **how)
        assert as_sent(ctx, query) == made_anew(state_at(ctx, "lab", query))


def test_a_new_revision_or_confidence_is_a_new_sheet(ctx: Context) -> None:
    rhythmic_lab(ctx)
    query = StateQuery(60.0 * 1003)
    before = as_sent(ctx, query)
    change_location(ctx, "lab", LocationChanges(confidence=0.51))
    assert as_sent(ctx, query) == made_anew(state_at(ctx, "lab", query))
    post_rows(ctx, "lab", [(60.0 * n, cell, 1) for n in range(200, 260) for cell in (5, 1599)])
    refit(ctx, "lab", estimator="fft", order=3)
    after = as_sent(ctx, query)
    assert after == made_anew(state_at(ctx, "lab", query)) != before


def test_only_what_has_waves_is_written_again(ctx: Context) -> None:
    rhythmic_lab(ctx)
    asked = ask(ctx, "lab", StateQuery(60.0 * 1003))
    buffer = buffered(ctx, asked).lease.value
    buffer.arrow.columns["probability"][:] = 9
    assert buffered(ctx, asked).lease.value is buffer
    assert (buffer.arrow.columns["probability"] == 9).tolist() == [False, False, False, True]


def test_what_was_seen_is_written_again_only_once_more_was(ctx: Context) -> None:
    rhythmic_lab(ctx)
    asked = ask(ctx, "lab", StateQuery(60.0 * 1003, observed=True))
    buffer = buffered(ctx, asked).lease.value
    buffer.arrow.columns["observed"][:] = 9
    assert buffered(ctx, asked).lease.value is buffer
    assert (buffer.arrow.columns["observed"] == 9).all()
    post_rows(ctx, "lab", [(60.0 * 300, 700, 1)])
    query = StateQuery(60.0 * 1003, observed=True)
    assert as_sent(ctx, query) == made_anew(state_at(ctx, "lab", query))


def test_once_warm_no_question_compiles_anything(ctx: Context) -> None:
    warm()
    compiled: Any = (kernels.values, kernels.write_verdicts, kernels.put_known, kernels.write_states)
    compiled += (kernels.unit_phasors, conditioning._condition, belief._condition)
    before = [len(each.signatures) for each in compiled]
    rhythmic_lab(ctx)
    for how in ({}, {"order": 1}, {"estimator": "calendar"}, {"estimator": "static"}, {"given": "observations"}):
        as_sent(ctx, StateQuery(60.0 * 1003, **how))
    refit(ctx, "lab", estimator="calendar")
    as_sent(ctx, StateQuery(60.0 * 1003))
    change_location(ctx, "lab", LocationChanges(sensor=Sensor(0.1, 0.1)))
    as_sent(ctx, StateQuery(60.0 * 1003, given="observations"))
    assert [len(each.signatures) for each in compiled] == before


def test_boxes_and_earlier_sightings_are_no_matter_for_buffers(ctx: Context) -> None:
    rhythmic_lab(ctx)
    for query in (
        StateQuery(0.0, bbox=(0.0,) * 6),
        StateQuery(0.0, observed=True),
        StateQuery(60.0 * 1003, last_seen=True),
    ):
        assert buffer_of(ctx, ask(ctx, "lab", query)) is None


def test_a_map_of_which_nothing_was_seen() -> None:
    nothing = blank(some_spectrum(), 5)
    buffer = StateBuffer.of(nothing, 0.9)
    buffer.write(nothing, 0.0, threads=1)
    with pa.ipc.open_stream(buffer.arrow.head(FACTS) + buffer.memory.tobytes()) as reader:
        table = reader.read_all()
    assert (table.num_rows, table.column_names) == (0, ["cell", "probability", "state", "verdict"])


def test_waves_of_cells_that_were_never_seen_say_nothing() -> None:
    spectrum = some_spectrum()
    mean = spectrum.mean.copy()
    mean[[0, 2]] = np.nan
    hidden = replace(spectrum, mean=mean)
    buffer = StateBuffer.of(hidden, 0.6)
    buffer.write(hidden, 1e6, threads=1)
    shown = StateBuffer.of(spectrum, 0.6)
    shown.write(spectrum, 1e6, threads=1)
    assert buffer.arrow.columns["cell"].tolist() == [1, 3]
    for name in ("probability", "state", "verdict"):
        np.testing.assert_array_equal(buffer.arrow.columns[name], shown.arrow.columns[name][[1, 3]])


def some_spectrum() -> Spectrum:
    """Four cells, the first and the last two with waves."""
    return Spectrum(
        link="identity",
        origin_s=0.0,
        time_zone=None,
        frequency_hz=np.array([1e-4, 3e-5]),
        gate=np.zeros(2, np.uint8),
        mean=np.array([0.5, 0.2, 0.7, 0.4], np.float32),
        cell=np.array([0, 2, 3], np.int32),
        index=np.array([[0, 1], [1, 0], [0, 1]], np.uint16),
        coefficient=np.full((3, 2), 0.1 + 0.1j, np.complex64),
        base=TimeBase(0.0, 1.0),
    )


@pytest.mark.parametrize("kept_bytes", [64 * 2**20, 0])
def test_concurrent_questions_never_share_a_buffer(database_url: str, kept_bytes: int) -> None:
    with opened(database_url, answer_cache_bytes=kept_bytes) as ctx:
        rhythmic_lab(ctx)
        expected = {n: made_anew(state_at(ctx, "lab", StateQuery(60.0 * n))) for n in range(1000, 1020)}
        assert len(set(expected.values())) > 5

        def check(number: int) -> None:
            n = 1000 + number % 20
            asked = ask(ctx, "lab", StateQuery(60.0 * n))
            answers = [buffered(ctx, asked), buffered(ctx, replace(asked, query=StateQuery(60.0 * 1000)))]
            assert [whole(each) for each in answers] == [expected[n], expected[1000]]

        with ThreadPoolExecutor(8) as pool:
            list(pool.map(check, range(400)))


def test_before_the_first_reading_nothing_is_conditioned(ctx: Context) -> None:
    rhythmic_lab(ctx)
    for query in (
        StateQuery(-60.0 * 1003, given="observations"),
        StateQuery(60.0 * 1003, as_of=-1.0, given="observations"),
    ):
        assert as_sent(ctx, query) == as_sent(ctx, replace(query, given="model", as_of=None))


QUERIES = st.builds(
    StateQuery,
    # Before all that was read, within it, in its last sample, and after it.
    time=st.sampled_from([-60.0, 60.0 * 50, 60.0 * 199, 60.0 * 199 + 20, 60.0 * 199 + 40, 60.0 * 203, 60.0 * 5000]),
    confidence=st.sampled_from([None, 0.5, 0.95]),
    order=st.sampled_from([None, 1]),
    estimator=st.sampled_from([None, "static", "calendar"]),
    observed=st.booleans(),
    as_of=st.sampled_from([None, -1.0, 60.0 * 90, 60.0 * 199 + 20]),
    given=st.sampled_from(["observations", "model"]),
)


@pytest.mark.parametrize(
    "how",
    [{}, {"missing": "hold", "hold_s": 600.0}, {"sensor": {"miss": 0.2, "false_alarm": 0.1}}],
    ids=["true", "hold", "errs"],
)
def test_whatever_is_asked_a_buffer_is_what_would_be_made_anew(ctx: Context, how: dict[str, Any]) -> None:
    make_location(ctx, "lab", (40, 40), confidence=0.8, **how)
    post_rows(ctx, "lab", [(60.0 * n, cell, int(n % 20 < 10)) for n in range(200) for cell in (3, 700, 1030)])
    # Cells that are read apart, one of them twice within the last sample.
    post_rows(ctx, "lab", [(60.0 * (5 * n % 200) + 10, 1100 + n, int(n % 3 == 0)) for n in range(400)])
    post_rows(ctx, "lab", [(60.0 * 199 + 30, 3, 1), (60.0 * 199 + 30, 1599, 1)])
    refit(ctx, "lab", estimator="fft", order=2)
    answered = []

    @settings(max_examples=60, deadline=None)
    @given(QUERIES)
    def check(query: StateQuery) -> None:
        answer = buffer_of(ctx, ask(ctx, "lab", query))
        answered.append(answer is not None)
        if answer is None:
            assert query.observed
            assert "sensor" in how or query.time < 60.0 * 199
        else:
            view = state_at(ctx, "lab", query)
            assert whole(answer) == made_anew(view)
            assert all(getattr(view, each.name) == getattr(answer.facts, each.name) for each in fields(answer.facts))

    check()
    assert any(answered)
