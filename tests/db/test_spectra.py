"""Spectra and revisions: what is visible, and when."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from sqlalchemy import func, select, update

from tests.support.contexts import make_location, post_rows, refit
from tests.support.rows import VALUES
from tidemap.errors import CorruptChunkError, LaterFormatError
from tidemap.history.timebase import TimeBase
from tidemap.services.context import Context, Loaded
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.spectra import fitted
from tidemap.services.state import StateQuery, state_at
from tidemap.spectral.conditioning import UNLEARNED
from tidemap.spectral.correction import LastingCorrection
from tidemap.spectral.recipe import Recipe
from tidemap.spectral.spectrum import Spectrum, static
from tidemap.storage.blobs import pack_json
from tidemap.storage.records import LocationRecord, RevisionRecord
from tidemap.storage.store import Store
from tidemap.storage.tables import revision, spectrum
from tidemap.storage.work import Work

BASE = TimeBase(0.0, 60.0)


@pytest.fixture
def location(store: Store) -> LocationRecord:
    """A grid of two chunks without a model."""
    grid = '{"frame": "map", "origin": [0, 0, 0], "resolution_m": 1.0, "shape": [40, 40]}'
    return store.write(lambda work: work.locations.create({**VALUES, "kind": "grid2d", "grid": grid}))


def record_of(location: LocationRecord, number: int, **changes: Any) -> RevisionRecord:
    chosen = {"estimator": "static", "reason": "ünïcode"}
    return RevisionRecord(
        **{
            "location_id": location.id,
            "revision": number,
            "recipe": Recipe("static", 0),
            "start": -7,
            "stop": 2**40,
            "observation_seq": 3,
            "measurements": 12,
            "accuracy": 0.75,
            "updated_at": 5.5,
            "selection": chosen,
            **changes,
        }
    )


def means(value: float) -> Spectrum:
    return static(np.full(4, value, np.float32), BASE)


def put_chunk(location_id: int, number: int, chunk: int, work: Work) -> None:
    work.spectra.put_chunk(location_id, number, chunk, means(chunk / 4))


def publish(record: RevisionRecord, work: Work) -> None:
    work.spectra.publish(record)


def put(store: Store, location: LocationRecord, number: int, chunks: range = range(2)) -> None:
    for chunk in chunks:
        store.write(partial(put_chunk, location.id, number, chunk))


def stored(store: Store, location: LocationRecord) -> tuple[int, dict[int, int]]:
    """The visible revision, and how many chunks of each are stored."""
    with store.read() as work:
        query = select(spectrum.c.revision, func.count()).group_by(spectrum.c.revision)
        chunks = {row[0]: row[1] for row in work.spectra._connection.execute(query)}
        return work.locations.get(location.name).revision, chunks


def test_a_revision_is_visible_once_it_is_published(store: Store, location: LocationRecord) -> None:
    put(store, location, 1)
    with store.read() as work:
        assert work.spectra.current() == {}
        assert work.spectra.next_number(location.id) == 2
    store.write(lambda work: work.spectra.publish(record_of(location, 1)))
    with store.read() as work:
        assert work.spectra.current() == {location.id: record_of(location, 1)}
        assert work.spectra.get(location.id, 1) == record_of(location, 1)
        assert work.spectra.get(location.id, 2) is None
        assert work.spectra.chunk(location, 1, 1).mean.tolist() == [0.25] * 4


def test_what_is_not_known_of_a_revision_stays_unknown(store: Store, location: LocationRecord) -> None:
    record = record_of(location, 1, accuracy=None, selection=None)
    store.write(lambda work: work.spectra.publish(record))
    with store.read() as work:
        assert work.spectra.get(location.id, 1) == record


def test_how_long_states_last_is_read_as_earlier_versions_stored_it_and_not_as_later_ones_do(
    store: Store, location: LocationRecord
) -> None:
    correction = LastingCorrection(60.0, np.ones((2, 2, 2)))
    record = record_of(location, 1, persistence=replace(UNLEARNED, correction=correction), offset={3: 0.5})
    store.write(lambda work: work.spectra.publish(record))
    with store.read() as work:
        found = work.spectra.get(location.id, 1)
        blob = work.spectra._connection.execute(select(revision.c.persistence)).scalar_one()
    assert found is not None
    assert found.persistence.as_dict() == record.persistence.as_dict()
    assert blob[0] == 2, "a version that knows no correction says that it cannot read it"
    set_persistence(store, pack_json({**UNLEARNED.as_dict(), "offset": []}))
    with store.read() as work:
        assert work.spectra.get(location.id, 1) == record_of(location, 1)
    set_persistence(store, b"\3" + blob[1:])
    with store.read() as work, pytest.raises(CorruptChunkError, match="is corrupt: its format is 3"):
        work.spectra.get(location.id, 1)
    set_persistence(store, pack_json({}, 3))
    says = "later version of Tidemap wrote the stored persistence of revision 1: its format is 3, this version reads 2"
    with store.read() as work, pytest.raises(LaterFormatError, match=says):
        work.spectra.get(location.id, 1)


def set_persistence(store: Store, blob: bytes) -> None:
    store.write(lambda work: work.spectra._connection.execute(update(revision).values(persistence=blob)))


def test_earlier_revisions_go(store: Store, location: LocationRecord) -> None:
    for number in (1, 2):
        put(store, location, number)
        store.write(partial(publish, record_of(location, number)))
    assert stored(store, location) == (2, {2: 2})
    with store.read() as work:
        assert work.spectra.get(location.id, 1) is None


def test_two_updates_at_once_do_not_take_each_others_chunks(store: Store, location: LocationRecord) -> None:
    put(store, location, 1)
    put(store, location, 2, range(1))
    store.write(lambda work: work.spectra.publish(record_of(location, 1)))
    assert stored(store, location) == (1, {1: 2, 2: 1})
    put(store, location, 2, range(1, 2))
    store.write(lambda work: work.spectra.publish(record_of(location, 2)))
    assert stored(store, location) == (2, {2: 2})


def test_a_slower_earlier_update_does_not_hide_a_later_one(store: Store, location: LocationRecord) -> None:
    put(store, location, 1)
    put(store, location, 2)
    for number in (2, 1):
        store.write(partial(publish, record_of(location, number)))
    assert stored(store, location) == (2, {2: 2})
    with store.read() as work:
        assert list(work.spectra.current().values()) == [record_of(location, 2)]


def test_a_number_is_not_used_again_after_a_crash(store: Store, location: LocationRecord) -> None:
    put(store, location, 1)
    store.write(lambda work: work.spectra.publish(record_of(location, 1)))
    put(store, location, 5, range(1))
    with store.read() as work:
        assert work.spectra.next_number(location.id) == 6
    put(store, location, 6)
    store.write(lambda work: work.spectra.publish(record_of(location, 6)))
    assert stored(store, location) == (6, {6: 2})


def test_publishing_for_a_deleted_location_leaves_nothing(store: Store, location: LocationRecord) -> None:
    store.write(lambda work: work.locations.delete(location.name))
    store.write(lambda work: work.spectra.publish(record_of(location, 1)))
    with store.read() as work:
        assert work.spectra._connection.execute(select(revision)).all() == []


def fit_lab(ctx: Context) -> None:
    make_location(ctx, "lab", (50, 50))
    post_rows(ctx, "lab", [(60.0 * n, cell, n % 2) for n in range(4) for cell in (0, 1030, 2400)])
    refit(ctx, "lab", estimator="fft", order=1)


def change_payload(ctx: Context, chunk: int, payload: bytes) -> None:
    def run(work: Work) -> None:
        work.spectra._connection.execute(update(spectrum).where(spectrum.c.chunk == chunk).values(payload=payload))

    ctx.store.write(run)


@pytest.mark.parametrize(
    ("payload", "reason"),
    [(b"", "cut short"), (b"\1\2\3\4\5\6", "checksum is wrong"), (b"\2rest", "format is 2, this version reads 1")],
)
def test_a_damaged_spectrum_is_named_and_hurts_no_other(ctx: Context, payload: bytes, reason: str) -> None:
    fit_lab(ctx)
    change_payload(ctx, 1, payload)
    with pytest.raises(CorruptChunkError, match=f"spectrum of location 'lab', chunk 1 is corrupt: .*{reason}"):
        predict_at(ctx, "lab", PredictQuery([0.0], [1030]))
    assert state_at(ctx, "lab", StateQuery(0.0)).cell.tolist() == [0, 2400]
    with ctx.store.read() as work:
        location = work.locations.get("lab")
        assert [work.spectra.chunk(location, 1, chunk).n_cells for chunk in (0, 2)] == [1024, 452]
    refit(ctx, "lab", estimator="fft", order=1)
    assert state_at(ctx, "lab", StateQuery(0.0)).cell.tolist() == [0, 1030, 2400]


def test_a_missing_chunk_is_named(ctx: Context) -> None:
    fit_lab(ctx)
    with (
        ctx.store.read() as work,
        pytest.raises(CorruptChunkError, match="chunk 3 is corrupt: it is missing from revision 1"),
    ):
        work.spectra.chunk(work.locations.get("lab"), 1, 3)


def test_an_update_between_asking_and_loading_is_followed(ctx: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """The chunks of a revision go when the next is published, also for a reader that is about to read them."""
    fit_lab(ctx)
    from tidemap.services import spectra

    load = spectra._load
    calls = []

    def late(*arguments: Any) -> Loaded:
        calls.append(1)
        if len(calls) == 1:
            refit(ctx, "lab", estimator="fft", order=1)
        return load(*arguments)

    monkeypatch.setattr(spectra, "_load", late)
    assert fitted(ctx, "lab").revision.revision == 2
    assert len(calls) == 2
