"""Scans in both databases: what is kept of them, for how long, and what goes with them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import Clock, make_location, post_rows, refit
from tests.support.scans import covariance
from tidemap.errors import CorruptChunkError, DomainError, LocationNotFoundError, ScanNotFoundError, ScanSettledError
from tidemap.formats.registry import Body
from tidemap.ingest.scan import SentScan
from tidemap.schemas.scans import ScanHeader
from tidemap.services.context import Context
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.locations import delete_location, get_location
from tidemap.services.posts import Observed, Post
from tidemap.services.pruning import prune
from tidemap.services.robots import has_scans, sensor_tracks
from tidemap.services.scans import ScanQuery, begin_scan, delete_scan, kept_bytes, list_scans, points_of, replay_scan
from tidemap.services.verify import verify
from tidemap.settings import DAY_S
from tidemap.storage.records import ScanRecord
from tidemap.storage.repositories import scans as repository
from tidemap.storage.tables import scan as scan_table

MODEL_ROWS = [(60.0 * t, cell, 0) for t in range(4) for cell in range(8)]
"""A map that has nothing to hold on to: scans with a poor pose go into quarantine."""


@pytest.fixture
def lab(ctx: Context) -> str:
    """A grid of 10 x 10 x 4 cells of half a metre with a model of nothing."""
    make_location(ctx, "lab", (10, 10, 4), estimator="static")
    post_rows(ctx, "lab", MODEL_ROWS)
    refit(ctx)
    return "lab"


def post(ctx: Context, time: float, stated: Any = None, n: int = 100, **how: Any) -> Observed:
    """Post a scan from the middle of the lab, with a covariance or without."""
    chance = np.random.default_rng(int(time))
    points = chance.uniform(-1, 1, (n, 3)).astype(np.float32)
    said = {} if stated is None else {"covariance": stated.tolist()}
    header = ScanHeader(time=time, map_from_sensor=[2.5, 2.5, 1.0, 0, 0, 0, 1], **said)
    body = Body(points.tobytes(), "points")
    return begin_scan(ctx, "lab", Post(body, **how), lambda: SentScan(header, points)).result()


POOR = covariance(0.5, 5.0)


def kept(ctx: Context, verdict: str | None = None) -> list[ScanRecord]:
    return list_scans(ctx, "lab", ScanQuery(verdict))


def test_what_became_of_a_scan_is_stored_with_its_observation(ctx: Context, lab: str) -> None:
    before = get_location(ctx, lab)
    placed, apart = post(ctx, 600.0, source="spot"), post(ctx, 660.0, POOR, source="spot")
    after = get_location(ctx, lab)
    assert after.observations == before.observations + placed.accepted
    assert (after.observation_seq, placed.number) == (before.observation_seq + 1, before.observation_seq + 1)
    assert (apart.accepted, apart.number) == (0, 0)
    second, first = kept(ctx)
    assert (first.verdict, first.observation, first.payload, first.source) == ("raw_pose", placed.number, None, "spot")
    assert (second.verdict, second.observation, second.n_bytes > 0) == ("quarantined", None, True)
    assert first == placed.scan
    assert kept(ctx, "quarantined") == [second]


def test_quarantine_is_bounded_and_the_oldest_give_way(ctx: Context, lab: str, monkeypatch: pytest.MonkeyPatch) -> None:
    size = post(ctx, 600.0, POOR).scan
    assert size is not None
    monkeypatch.setattr(repository, "MAX_QUARANTINE_BYTES", 3 * size.n_bytes + 200)
    placed = post(ctx, 610.0)
    made = [post(ctx, 620.0 + i, POOR).scan for i in range(5)]
    found = kept(ctx)
    assert [each.id for each in found] == [scan.id for scan in made[:1:-1] if scan] + [placed.scan and placed.scan.id]
    assert sum(each.n_bytes for each in found) <= repository.MAX_QUARANTINE_BYTES


def test_points_that_pack_well_fill_quarantine_as_others_do(ctx: Context, lab: str) -> None:
    points = np.full((5000, 3), 0.5, np.float32)
    header = ScanHeader(time=600.0, map_from_sensor=[2.5, 2.5, 1.0, 0, 0, 0, 1], covariance=POOR.tolist())
    apart = begin_scan(ctx, lab, Post(Body(b"", "")), lambda: SentScan(header, points)).result().scan
    assert apart is not None
    assert apart.payload is not None
    assert (len(apart.payload) < 5000, apart.n_bytes) == (True, points.nbytes)
    assert kept_bytes(ctx, lab, apart.id) == points.nbytes


def test_quarantine_holds_so_many_scans_and_the_oldest_give_way(
    ctx: Context, lab: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repository, "MAX_QUARANTINED", 3)
    placed = post(ctx, 610.0).scan
    made = [post(ctx, 620.0 + i, POOR).scan for i in range(5)]
    assert [each.id for each in kept(ctx)] == [each.id for each in (*made[:1:-1], placed) if each]


def test_a_scan_is_listed_for_its_time_and_keeps_nothing_else_with_it(ctx: Context, clock: Clock, lab: str) -> None:
    clock.now = 10 * DAY_S
    post(ctx, clock.now - 60, POOR)
    post(ctx, clock.now - 60)
    before = get_location(ctx, lab).observations
    clock.now += ctx.settings.scans_s - 1
    prune(ctx)
    assert len(kept(ctx)) == 2
    post(ctx, clock.now - 60)
    clock.now += 2
    assert prune(ctx) >= 2
    assert len(kept(ctx)) == 1
    assert get_location(ctx, lab).observations > before


def test_a_key_is_used_once_in_quarantine_as_elsewhere(ctx: Context, lab: str) -> None:
    first, again = (post(ctx, 600.0, POOR, idempotency_key="k") for _ in range(2))
    assert (first.duplicate, again.duplicate) == (False, True)
    assert first.scan is not None
    assert again.scan is not None
    assert again.scan.id == first.scan.id
    assert len(kept(ctx)) == 1
    delete_scan(ctx, lab, first.scan.id)
    assert not post(ctx, 600.0, POOR, idempotency_key="k").duplicate, "what was dropped may come again"


def test_scans_that_come_at_once_are_all_stored(ctx: Context, lab: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda i: post(ctx, 600.0 + i, POOR if i % 2 else None), range(12)))
    ids = sorted(answer.scan.id for answer in answers if answer.scan)
    assert [each.id for each in kept(ctx)] == ids[::-1]
    assert len(set(ids)) == 12


def test_a_scan_is_replayed_once(ctx: Context, lab: str) -> None:
    apart = post(ctx, 600.0, POOR).scan
    assert apart is not None
    path = (ctx, lab, apart.id)
    assert points_of(*path).shape == (100, 3)
    still = replay_scan(*path)
    assert still.scan is not None
    assert (still.accepted, still.scan.id, still.scan.verdict) == (0, apart.id, "quarantined")
    with ctx.store.read() as work:
        connection = work.jobs._connection
        assert connection.execute(scan_table.select()).mappings().one()["received_at"] == apart.received_at
    # A location whose model is gone takes scans at their pose.
    ctx.store.write(lambda work: work.locations.change("lab", {"revision": 0}))
    ctx.caches.locations.forget()
    before = get_location(ctx, lab).observations
    stored = replay_scan(*path)
    assert stored.scan is not None
    assert (stored.scan.verdict, stored.scan.observation, stored.scan.payload) == ("raw_pose", stored.number, None)
    assert get_location(ctx, lab).observations == before + stored.accepted
    for call in (replay_scan, points_of):
        with pytest.raises(ScanSettledError):
            call(*path)
    (listed,) = kept(ctx)
    assert (listed.observation, listed.n_bytes) == (stored.number, 0)


def test_a_location_takes_its_scans_along(ctx: Context, lab: str) -> None:
    apart = post(ctx, 600.0, POOR).scan
    assert apart is not None
    delete_location(ctx, lab)
    for call in (replay_scan, points_of, delete_scan):
        with pytest.raises(LocationNotFoundError):
            call(ctx, lab, apart.id)
    make_location(ctx, lab, (10, 10, 4))
    with pytest.raises(ScanNotFoundError):
        delete_scan(ctx, lab, apart.id)
    assert kept(ctx) == []


def test_a_location_that_goes_meanwhile_keeps_no_scan(ctx: Context, lab: str) -> None:
    chance = np.ones((100, 3), np.float32)
    header = ScanHeader(time=600.0, map_from_sensor=[2.5, 2.5, 1.0, 0, 0, 0, 1], covariance=POOR.tolist())
    ctx.caches.locations.get(lab, lambda name: get_location(ctx, name))

    def read() -> SentScan:
        ctx.store.write(lambda work: work.locations.delete(lab))
        return SentScan(header, chance)

    with pytest.raises(DomainError):
        begin_scan(ctx, lab, Post(Body(b"", "")), read).result()
    with ctx.store.read() as work:
        assert work.jobs._connection.execute(scan_table.select()).first() is None


def test_scans_go_with_the_observations_of_their_time(ctx: Context, lab: str) -> None:
    for i, stated in enumerate((None, POOR, POOR, POOR)):
        post(ctx, 600.0 + 60 * i, stated, source="spot" if i < 3 else "rover")
    assert delete_observations(ctx, lab, Deletion(600.0, 720.0)) > 0
    assert [each.time for each in kept(ctx)] == [780.0, 720.0]
    assert delete_observations(ctx, lab, Deletion(700.0, 900.0, "rover")) == 0
    assert [each.time for each in kept(ctx)] == [720.0]


def damaged(ctx: Context, change: Callable[[bytes], bytes]) -> int:
    """A scan in quarantine whose stored points are changed; its id."""
    apart = post(ctx, 600.0, POOR).scan
    assert apart is not None
    with ctx.store.read() as work:
        payload = work.scans.find(apart.location_id, apart.id)
    assert payload is not None
    assert payload.payload is not None
    broken = change(payload.payload)
    ctx.store.write(lambda work: work.jobs._connection.execute(scan_table.update().values(payload=broken)))
    return apart.id


def test_damaged_points_are_reported_and_not_believed(ctx: Context, lab: str) -> None:
    number = damaged(ctx, lambda blob: blob[:-1] + bytes([blob[-1] ^ 1]))
    for call in (replay_scan, points_of):
        with pytest.raises(CorruptChunkError, match=f"points of scan {number}"):
            call(ctx, lab, number)
    found: list[Any] = []
    verify(ctx.settings.url, found.append)
    assert [each.where for each in found] == [f"scan {number}"]


def test_sensors_have_tracks_of_the_poses_that_stand(ctx: Context, lab: str) -> None:
    location = get_location(ctx, lab)
    assert not has_scans(ctx, location.id)
    for time, source in ((600.0, "spot"), (900.0, None), (720.0, "spot"), (4400.0, None)):
        post(ctx, time, source=source)
    post(ctx, 660.0, POOR, source="spot")
    assert has_scans(ctx, location.id)
    tracks = sensor_tracks(ctx, location.id, 600.0, 4200.0)
    assert [(track.source, track.time.tolist()) for track in tracks] == [("", [900.0]), ("spot", [600.0, 720.0])]
    assert tracks[0].map_from_sensor[0].translation.tolist() == [2.5, 2.5, 1.0]
