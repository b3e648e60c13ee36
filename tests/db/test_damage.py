"""One corrupt blob: it is named, its chunk alone is unavailable, its bytes stay, and nothing that comes in is lost."""

import logging

import numpy as np
import pytest
from sqlalchemy import Table, delete, select, update

from tests.support.contexts import (
    NOW,
    Clock,
    compact_now,
    history_of,
    make_location,
    opened,
    post_rows,
    post_states,
    refit,
)
from tidemap.errors import CorruptChunkError
from tidemap.services.acknowledging import acknowledge
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.detect import DetectQuery, detect
from tidemap.services.evaluate import EvaluateQuery, evaluate
from tidemap.services.locations import (
    LocationChanges,
    change_location,
    delete_location,
    find_location,
    list_locations,
)
from tidemap.services.model import model_of
from tidemap.services.overview import overview
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import StateQuery, state_at
from tidemap.services.verify import Finding, verify
from tidemap.storage.repositories.locations import LocationFilter
from tidemap.storage.tables import anomaly, history, observation, revision, spectrum
from tidemap.storage.work import Work

MINUTE = 60.0
CELLS = (0, 1030, 1031, 2400)
"""Cells of three chunks; those in the middle one get damaged."""
MIDDLE = [(1024, 2048)]


def make_lab(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    post_rows(ctx, "lab", [(MINUTE * n, cell, n % 2) for n in range(6) for cell in CELLS])
    refit(ctx, "lab", estimator="fft", order=1)


def damage(ctx: Context, table: Table, **where: int) -> bytes:
    """Flip a bit of the one blob of a row; the sound one."""

    def run(work: Work) -> bytes:
        mine = [table.c[name] == value for name, value in where.items()]
        connection = work.jobs._connection
        sound = bytes(connection.execute(select(table.c.payload).where(*mine)).scalar_one())
        connection.execute(update(table).where(*mine).values(payload=sound[:-1] + bytes([sound[-1] ^ 1])))
        return sound

    return ctx.store.write(run)


def put_back(ctx: Context, table: Table, sound: bytes, **where: int) -> None:
    mine = [table.c[name] == value for name, value in where.items()]
    ctx.store.write(lambda work: work.jobs._connection.execute(update(table).where(*mine).values(payload=sound)))


def payload(ctx: Context, table: Table, **where: int) -> bytes:
    mine = [table.c[name] == value for name, value in where.items()]
    with ctx.store.read() as work:
        return bytes(work.jobs._connection.execute(select(table.c.payload).where(*mine)).scalar_one())


def findings(ctx: Context) -> list[str]:
    found: list[Finding] = []
    verify(ctx.settings.url, found.append)
    return [str(finding) for finding in found]


class TestSpectrum:
    """A damaged chunk of the spectrum."""

    def test_the_other_chunks_answer(self, ctx: Context) -> None:
        make_lab(ctx)
        whole = state_at(ctx, "lab", StateQuery(0.0))
        assert (whole.cell.tolist(), whole.unavailable) == (list(CELLS), [])
        ctx.caches.spectra.drop(lambda _: True)
        damage(ctx, spectrum, chunk=1)
        for observed in (False, True):
            view = state_at(ctx, "lab", StateQuery(0.0, observed=observed))
            assert (view.cell.tolist(), view.unavailable) == ([0, 2400], MIDDLE)
            np.testing.assert_array_equal(view.probability, whole.probability[[0, 3]])
        every = predict_at(ctx, "lab", PredictQuery([0.0]))
        assert np.flatnonzero(~np.isnan(every.probability[:, 0])).tolist() == [0, 2400]
        assert every.unavailable == MIDDLE
        assert predict_at(ctx, "lab", PredictQuery([0.0], [2400, 0])).probability[:, 0].tolist() == pytest.approx(
            whole.probability[[3, 0]].tolist()
        )
        assert model_of(ctx, "lab", 2400).spectrum.mean[0] == pytest.approx(0.5)
        assert series(ctx, "lab", SeriesQuery(0)).observed.tolist() == [0, 1] * 3

    def test_a_question_about_it_is_a_clear_error(self, ctx: Context) -> None:
        make_lab(ctx)
        ctx.caches.spectra.drop(lambda _: True)
        damage(ctx, spectrum, chunk=1)
        for ask in (
            lambda: predict_at(ctx, "lab", PredictQuery([0.0], [0, 1500])),
            lambda: series(ctx, "lab", SeriesQuery(1030)),
            lambda: model_of(ctx, "lab", 1030),
            lambda: model_of(ctx, "lab", 1030, order=0),
        ):
            with pytest.raises(CorruptChunkError, match="spectrum of location 'lab', chunk 1 is corrupt: its checksum"):
                ask()

    def test_it_is_told_of_once_and_counted_until_it_is_repaired(
        self, ctx: Context, caplog: pytest.LogCaptureFixture
    ) -> None:
        make_lab(ctx)
        ctx.caches.spectra.drop(lambda _: True)
        damage(ctx, spectrum, chunk=1)
        with caplog.at_level(logging.ERROR):
            for order in (None, 0, None):
                state_at(ctx, "lab", StateQuery(0.0, order=order))
        assert [record.message.count("location 'lab', chunk 1") for record in caplog.records] == [1]
        assert ctx.damage.count() == 1
        refit(ctx, "lab", estimator="fft", order=1)
        assert ctx.damage.count() == 0
        assert state_at(ctx, "lab", StateQuery(0.0)).unavailable == []
        assert findings(ctx) == []

    def test_posts_go_on_where_nothing_can_be_read(self, ctx: Context) -> None:
        make_location(ctx, "door", estimator="static", min_cells=1)
        post_states(ctx, "door", [0.0, MINUTE], [0, 0])
        refit(ctx, "door")
        ctx.caches.spectra.drop(lambda _: True)
        damage(ctx, spectrum, chunk=0)
        with pytest.raises(CorruptChunkError, match="location 'door', chunk 0"):
            state_at(ctx, "door", StateQuery(0.0))
        assert post_states(ctx, "door", [2 * MINUTE], [1]).accepted == 1
        assert ctx.damage.count() == 1
        refit(ctx, "door")
        assert series(ctx, "door").observed.tolist() == [0, 0, 1]

    def test_a_deleted_location_counts_no_more(self, ctx: Context) -> None:
        make_lab(ctx)
        ctx.caches.spectra.drop(lambda _: True)
        damage(ctx, spectrum, chunk=1)
        state_at(ctx, "lab", StateQuery(0.0))
        delete_location(ctx, "lab")
        assert ctx.damage.count() == 0


class TestHistory:
    """A damaged segment of the history."""

    def test_update_and_compaction_go_on_for_the_others(self, ctx: Context) -> None:
        make_lab(ctx)
        damage(ctx, history, chunk=1)
        ctx.caches.histories.drop(lambda _: True)
        spoilt = payload(ctx, history, chunk=1)
        post_rows(ctx, "lab", [(MINUTE * 6, cell, 1) for cell in (*CELLS, 1600)])
        assert refit(ctx, "lab", estimator="fft", order=1).revision == 2
        view = state_at(ctx, "lab", StateQuery(0.0))
        assert (view.cell.tolist(), view.unavailable) == ([0, 2400], MIDDLE)
        for n in (7, 8):
            post_rows(ctx, "lab", [(MINUTE * n, cell, 1) for cell in CELLS])
            compact_now(ctx, "lab")
        location = find_location(ctx, "lab")
        assert location.compacted_seq == location.observation_seq == 4
        assert payload(ctx, history, chunk=1) == spoilt
        assert series(ctx, "lab", SeriesQuery(2400)).observed.tolist() == [0, 1, 0, 1, 0, 1, 1, 1, 1]
        with pytest.raises(CorruptChunkError, match="history of location 'lab', chunk 1, segment 0 is corrupt"):
            history_of(ctx, "lab", 1, 0, 2)
        assert findings(ctx) == [
            "location 'lab', history chunk 1, segment 0: its checksum is wrong",
            "location 'lab', spectrum chunk 1 of revision 2: it is missing",
        ]

    def test_once_it_is_put_back_nothing_is_missing(self, ctx: Context) -> None:
        make_lab(ctx)
        make_location(ctx, "twin", (50, 50))
        post_rows(ctx, "twin", [(MINUTE * n, cell, n % 2) for n in range(6) for cell in CELLS])
        sound = damage(ctx, history, location_id=find_location(ctx, "lab").id, chunk=1)
        for n in (6, 3, 5000, 5001):
            # Some new, some late: it replaces what was measured earlier in that sample.
            rows = [(MINUTE * n + 30, cell, 0) for cell in (*CELLS, 1600)]
            for name in ("lab", "twin"):
                post_rows(ctx, name, rows)
                compact_now(ctx, name)
        put_back(ctx, history, sound, location_id=find_location(ctx, "lab").id, chunk=1, segment=0)
        for _ in range(2):
            for chunk in range(3):
                mine, other = (history_of(ctx, name, chunk, 0, 5002) for name in ("lab", "twin"))
                np.testing.assert_array_equal(mine.states(), other.states())
            refit(ctx, "lab", estimator="static")
            post_rows(ctx, "lab", [(MINUTE * n + 30, 1600, 0) for n in (6, 5000)])
            compact_now(ctx, "lab")
        assert state_at(ctx, "lab", StateQuery(0.0)).unavailable == []
        assert findings(ctx) == []
        with ctx.store.read() as work:
            assert work.segments._asides(find_location(ctx, "lab")) == []

    def test_where_it_is_given_up_what_came_in_since_is_there(self, ctx: Context) -> None:
        make_lab(ctx)
        damage(ctx, history, chunk=1)
        post_rows(ctx, "lab", [(MINUTE * 6, 1030, 1)])
        compact_now(ctx, "lab")
        gone = delete(history).where(history.c.chunk == 1)
        ctx.store.write(lambda work: work.jobs._connection.execute(gone))
        ctx.caches.histories.drop(lambda _: True)
        assert history_of(ctx, "lab", 1, 0, 7).series(6, 0, 7).tolist() == [2] * 6 + [1]
        refit(ctx, "lab", estimator="static")
        assert state_at(ctx, "lab", StateQuery(0.0)).cell.tolist() == [0, 1030, 2400]

    def test_other_segments_and_searches_leave_it_out(self, ctx: Context) -> None:
        make_lab(ctx)
        post_rows(ctx, "lab", [(MINUTE * 5000, cell, 1) for cell in CELLS])
        refit(ctx, "lab", estimator="static")
        damage(ctx, history, chunk=1, segment=0)
        ctx.caches.histories.drop(lambda _: True)
        assert history_of(ctx, "lab", 1, 4096, 5001).series(6, 5000, 5001).tolist() == [1]
        view = state_at(ctx, "lab", StateQuery(MINUTE * 9, observed=True))
        assert view.cell.tolist() == list(CELLS)
        assert view.observed is not None
        assert view.observed.tolist() == [1, 2, 2, 1]
        assert view.unavailable == MIDDLE
        events, _ = detect(ctx, "lab", DetectQuery(0.0, MINUTE * 6, confidence=0.5))
        assert {cell for event in events for cell in event.cells} == {0, 2400}
        form = EvaluateQuery(start=0.0, stop=MINUTE * 6, orders=[0], estimators=["static"])
        assert evaluate(ctx, "lab", form).candidates[0].scores.n == 12

    def test_the_only_chunk_keeps_its_model(self, ctx: Context) -> None:
        make_location(ctx, "door")
        post_states(ctx, "door", [0.0, MINUTE], [0, 1])
        refit(ctx, "door", estimator="static")
        damage(ctx, history, chunk=0)
        ctx.caches.histories.drop(lambda _: True)
        post_states(ctx, "door", [MINUTE * 2], [1])
        with pytest.raises(CorruptChunkError, match="history of location 'door', chunk 0, segment 0"):
            refit(ctx, "door", estimator="static")
        assert state_at(ctx, "door", StateQuery(0.0)).revision == 1

    def test_retention_takes_it_once_it_is_old(self, database_url: str) -> None:
        with opened(database_url, Clock(MINUTE * 5000)) as ctx:
            make_lab(ctx)
            damage(ctx, history, chunk=1)
            post_rows(ctx, "lab", [(MINUTE * 6, 1030, 1)])
            for retention, left in ((MINUTE * 4996, True), (MINUTE * 60, False)):
                post_rows(ctx, "lab", [(MINUTE * 5000, cell, 1) for cell in CELLS])
                change_location(ctx, "lab", LocationChanges(retention_s=retention))
                refit(ctx, "lab", estimator="static")
                assert bool(findings(ctx)) == left
            assert state_at(ctx, "lab", StateQuery(0.0)).unavailable == []


def test_an_event_whose_cells_are_damaged_is_shown_without_them(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50), min_cells=1, confidence=0.6)
    post_rows(ctx, "lab", [(MINUTE * n, 7, 0) for n in range(6)])
    refit(ctx, "lab", estimator="static")
    for n in (6, 60):
        post_rows(ctx, "lab", [(MINUTE * n, 7, 1)])
    first = update(anomaly).where(anomaly.c.id == 1).values(cells=b"")
    ctx.store.write(lambda work: work.jobs._connection.execute(first))
    events = list_events(ctx, EventQuery())
    assert [(event.id, event.cells.tolist(), event.bbox is None) for event in events] == [
        (1, [], True),
        (2, [7], False),
    ]
    post_rows(ctx, "lab", [(MINUTE * 7, 7, 1)])
    assert [event.id for event in list_events(ctx, EventQuery())] == [1, 2, 3], "nothing continues it"
    assert acknowledge(ctx, 1, "me", None).acknowledged_by == "me"
    assert ctx.damage.count() == 1


class TestLog:
    """A damaged observation of the log."""

    def test_the_others_are_read_and_compacted(self, ctx: Context, caplog: pytest.LogCaptureFixture) -> None:
        make_lab(ctx)
        for n in (6, 7, 8):
            post_rows(ctx, "lab", [(MINUTE * n, cell, 1) for cell in CELLS])
        damage(ctx, observation, id=3)
        ctx.caches.tails.drop(lambda _: True)
        spoilt = payload(ctx, observation, id=3)
        assert series(ctx, "lab", SeriesQuery(1030)).observed.tolist() == [0, 1] * 3 + [1, 2, 1]
        with caplog.at_level(logging.ERROR):
            for _ in range(2):
                compact_now(ctx, "lab")
        assert find_location(ctx, "lab").compacted_seq == 4
        assert history_of(ctx, "lab", 1, 0, 9).series(6, 0, 9).tolist() == [0, 1, 0, 1, 0, 1, 1, 2, 1]
        assert payload(ctx, observation, id=3) == spoilt
        assert findings(ctx) == ["location 'lab', observation 3: its checksum is wrong"]

    def test_the_last_one(self, ctx: Context) -> None:
        make_lab(ctx)
        post_rows(ctx, "lab", [(MINUTE * 6, 0, 1)])
        damage(ctx, observation, id=2)
        compact_now(ctx, "lab")
        assert find_location(ctx, "lab").compacted_seq == 2
        post_rows(ctx, "lab", [(MINUTE * 6, 0, 1)])
        refit(ctx, "lab", estimator="static")
        assert history_of(ctx, "lab", 0, 0, 9).series(0, 0, 7).tolist() == [0, 1] * 3 + [1]


@pytest.mark.parametrize("column", ["recipe", "persistence", "selection", "chunks"])
def test_a_revision_that_cannot_be_read_keeps_nobody_from_other_locations(ctx: Context, column: str) -> None:
    make_lab(ctx)
    make_location(ctx, "door")
    post_states(ctx, "door", [MINUTE * n for n in range(6)], [n % 2 for n in range(6)])
    refit(ctx, "door", estimator="static")
    broken = update(revision).where(revision.c.location_id == find_location(ctx, "lab").id).values({column: b"torn"})
    ctx.store.write(lambda work: work.spectra._connection.execute(broken))
    for found in (list_locations(ctx), [row.location for row in overview(ctx, LocationFilter(), 0, 10).rows]):
        assert {each.name: each.updated_at is not None for each in found} == {"door": True, "lab": False}
    with pytest.raises(CorruptChunkError):
        state_at(ctx, "lab", StateQuery(NOW))
    assert state_at(ctx, "door", StateQuery(NOW)).revision == 1
    assert any("revision" in finding for finding in findings(ctx))
    refit(ctx, "lab", estimator="fft", order=1)
    assert state_at(ctx, "lab", StateQuery(NOW)).revision == 2
