"""The client against a real server process; every test runs with the blocking and the asynchronous client."""

import asyncio
import inspect
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import numpy as np
import pytest

from tests.support.server import ServerProcess, StartServer
from tests.support.waiting import WAIT_S, until
from tidemap.client import AsyncClient, Client, RetryPolicy, TidemapError
from tidemap.client.operation import Awaited
from tidemap.schemas.locations import SensorRates

DAY_S = 86400.0
START = 1_767_225_600.0  # 2026-01-01 00:00 UTC, a Thursday
GRID = {"resolution_m": 0.5, "shape": [4, 3, 2]}


class Waited:
    """An awaited client or handle as a blocking one."""

    def __init__(self, awaited: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._awaited = awaited
        self._loop = loop

    def __getattr__(self, name: str) -> Any:
        return self._wrap(getattr(self._awaited, name))

    def _wrap(self, value: Any) -> Any:
        if inspect.iscoroutine(value):
            return self._wrap(self._loop.run_until_complete(value))
        if hasattr(value, "__aiter__"):
            return self._items(value)
        if isinstance(value, Awaited):
            return Waited(value, self._loop)
        if inspect.ismethod(value):
            return lambda *args, **kwargs: self._wrap(value(*args, **kwargs))
        return value

    def _items(self, items: Any) -> Iterator[Any]:
        try:
            while True:
                yield self._loop.run_until_complete(anext(items))
        except StopAsyncIteration:
            return
        finally:
            self._loop.run_until_complete(items.aclose())


@pytest.fixture(params=["blocking", "awaited"])
def connect(request: pytest.FixtureRequest) -> Iterator[Callable[..., Any]]:
    """Makes clients of one kind: `connect(url, key=...)`."""
    with ExitStack() as stack:
        loop = stack.enter_context(closing(asyncio.new_event_loop()))

        def make(url: str, **how: Any) -> Any:
            client = Client(url, **how) if request.param == "blocking" else Waited(AsyncClient(url, **how), loop)
            return stack.enter_context(closing(client))

        yield make


@pytest.fixture
def client(connect: Callable[..., Any], shared_server: ServerProcess) -> Any:
    return connect(shared_server.url)


@pytest.fixture
def name(request: pytest.FixtureRequest) -> str:
    """A location's name of this test's own."""
    kept = (c if c.isalnum() else "-" for c in request.node.name)
    return "".join(kept)[:100]


def daily(days: int, interval_s: float = 600.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and states of a door that is open from nine to five UTC."""
    time_s = START + np.arange(0, days * DAY_S, interval_s)
    hour = time_s % DAY_S / 3600
    return time_s, ((hour >= 9) & (hour < 17)).astype(np.uint8)


def door(client: Any, name: str, days: int = 4) -> Any:
    """A location with a model of a daily rhythm."""
    handle = client.create_location(name, interval_s=600, estimator="fft", order=5)
    handle.observe(*daily(days))
    assert handle.update(wait=True).state == "done"
    return handle


def test_the_life_of_a_door(client: Any, name: str) -> None:
    handle = client.create_location(name, kind="state", interval_s=600, estimator="fft", order=5)
    times, states = daily(4)
    accepted = handle.observe(time=times, state=states)
    assert (accepted.accepted, accepted.duplicate) == (len(times), False)
    assert (accepted.first_time, accepted.last_time) == (times[0], times[-1])
    job = handle.update(wait=True)
    assert (job.state, job.location, job.progress) == ("done", name, 1)

    noon = datetime(2026, 1, 9, 12, tzinfo=UTC)
    prediction = handle.predict(time=[noon, noon + timedelta(hours=12)])
    assert prediction.probability.shape == (1, 2)
    assert prediction.probability[0, 0] > 0.8 > 0.2 > prediction.probability[0, 1]
    assert prediction.state.tolist() == [[1, 0]]
    assert prediction.revision == 1
    assert prediction.time[0] == noon.timestamp()

    now = handle.state(time=noon, confidence=0.75)
    assert (now.cell.tolist(), now.verdict.tolist(), now.confidence) == ([0], ["occupied"], 0.75)
    assert (now.time, now.estimator, now.order, now.shape) == (noon.timestamp(), "fft", 5, (1,))

    series = handle.series(start=times[0], stop=times[0] + DAY_S, step=3600)
    assert series.observed.tolist() == [int(9 <= hour < 17) for hour in range(24)]

    looks = handle.information(time=noon, given="model")
    assert (looks.cell.tolist(), looks.cells, looks.given) == ([0], 1, "model")
    assert looks.information[0] == looks.cell_information[0] == pytest.approx(looks.cell_entropy[0])
    day = handle.information(start=noon, stop=noon + timedelta(days=1), step=3600, best=2, as_of=noon, miss=0.1)
    assert (len(day.time), day.cell, day.as_of) == (24, None, noon.timestamp())
    assert (day.information < day.entropy).all()
    assert day.best_information.tolist() == sorted(day.best_information, reverse=True)
    assert abs(np.diff(day.best_time)[0]) >= day.apart_s > 0

    model = handle.model(order=2)
    assert (model.order, len(model.components)) == (2, 2)
    scores = handle.evaluate(orders=[0, 5], estimators=["fft"], start=times[0], stop=times[-1] + 600)
    assert [row.order for row in scores.results] == [0, 5]
    assert scores.results[1].error < scores.results[0].error
    given = handle.evaluate(orders=[5], estimators=["fft"], time=[noon], state=[True])
    assert (given.results[0].error, given.results[0].n) == (0, 1)

    ahead = handle.evaluate(horizons_s=[600, 7200], start=times[-1] - DAY_S)
    assert [row.samples for row in ahead.horizons] == [1, 12]
    assert all(row.conditioned.n == 144 + 1 for row in ahead.horizons)

    info = handle.get()
    assert (info.observations, info.revision, info.kind) == (len(times), 1, "state")
    assert name in [location.name for location in client.locations()]


def test_a_map_comes_out_as_a_file(client: Any, name: str) -> None:
    lab = client.create_location(name, kind="grid3d", interval_s=60, grid=GRID)
    lab.observe_grid(START, occupied=[(1, 2, 1)], free=[(0, 0, 0)])
    file = lab.export("octomap", START + 90, source="observed", z_min=0.5)
    assert (file.name, file.time, file.revision, file.unavailable) == (f"{name}.bt", START + 90, 0, "")
    assert file.content.startswith(b"# Octomap OcTree binary file")
    with pytest.raises(TidemapError, match="no model yet"):
        lab.export("nav2")
    with pytest.raises(TidemapError) as refused:
        lab.export("bag")
    assert refused.value.errors[0].field == "format"


def test_a_grid_seen_look_by_look(client: Any, name: str) -> None:
    handle = client.create_location(name, kind="grid3d", interval_s=60, grid=GRID)
    handle.observe_grid(START, occupied=[0, 5], free=[1])
    handle.observe_grid(START + 60, occupied=[[0, 0, 1]], free=np.array([[3, 2, 1]]))
    handle.update(wait=True)
    state = handle.state(time=START + 60, observed=True)
    assert dict(zip(state.cell.tolist(), state.observed.tolist(), strict=True)) == {0: 1, 1: 1, 5: 1, 23: 0}
    dense = state.dense("observed")
    assert dense.shape == (4, 3, 2)
    assert (dense[0, 0, 1], dense[3, 2, 1], dense[2, 0, 0]) == (1, 0, -1)
    assert np.isnan(state.dense()[2, 0, 0])
    corner = handle.state(time=START, bbox=(0, 0, 0, 0.5, 0.5, 1))
    assert corner.cell.tolist() == [0, 1]


def test_a_grid_seen_whole(client: Any, name: str) -> None:
    handle = client.create_location(name, kind="grid3d", interval_s=60, grid=GRID)
    seen = np.full((4, 3, 2), -1)
    seen[:, 0], seen[2, 1, 1] = 0, 1
    assert handle.observe_grid(START, grid=seen).accepted == 9
    assert handle.observe_grid(START + 60, grid=np.where(seen < 0, 255, seen).astype(np.uint8)).accepted == 9
    assert handle.observe_grid(START + 120, grid=np.asfortranarray(seen)).accepted == 9
    handle.update(wait=True)
    for time_s in (START, START + 60, START + 120):
        np.testing.assert_array_equal(handle.state(time_s, observed=True).dense("observed"), seen)
    with pytest.raises(TidemapError) as caught:
        handle.observe_grid(START, grid=seen.T)
    assert (caught.value.status, caught.value.errors[0].field) == (422, "body")
    for wrong in ({"grid": seen, "occupied": [0]}, {"grid": seen + 2}, {"grid": seen / 2}):
        with pytest.raises(ValueError, match=r"give either|a state is"):
            handle.observe_grid(START, **wrong)


def test_many_looks_from_columns(client: Any, name: str) -> None:
    handle = client.create_location(name, kind="grid3d", interval_s=60, grid=GRID)
    times = np.repeat(START + 60 * np.arange(5), 24)
    cells = np.tile(np.arange(24), 5)
    assert handle.observe(times, cells % 2, cells).accepted == 120
    handle.update(wait=True)
    np.testing.assert_array_equal(handle.state(time=START + 240).dense("state").ravel(), np.arange(24) % 2)


def test_more_than_a_post_holds_is_split_and_stored_once(client: Any, name: str) -> None:
    handle = client.create_location(name, kind="grid2d", interval_s=60, grid={"resolution_m": 1, "shape": [500, 300]})
    cells = np.tile(np.arange(150_000, dtype=np.uint32), 3)
    times = np.repeat([START, START + 60, START + 120], 150_000)
    accepted = handle.observe(times, np.zeros(450_000, np.uint8), cells)
    assert (accepted.accepted, accepted.first_time, accepted.last_time) == (450_000, START, START + 120)
    assert handle.get().observations == 450_000


def test_an_idempotency_key_of_ones_own_holds_across_calls(client: Any, name: str) -> None:
    handle = client.create_location(name, interval_s=60)
    assert not handle.observe([START], [1], idempotency_key="monday").duplicate
    again = handle.observe([START], [1], idempotency_key="monday")
    assert again.duplicate
    assert handle.get().observations == 1
    with pytest.raises(TidemapError) as caught:
        handle.observe([START], [0], idempotency_key="monday")
    assert caught.value.status == 409
    assert caught.value.type.endswith("idempotency-key-reused")


def test_errors_come_in_the_servers_own_words(client: Any, name: str) -> None:
    missing = client.location(name)
    with pytest.raises(TidemapError, match=name) as caught:
        missing.get()
    assert caught.value.status == 404
    handle = client.create_location(name, interval_s=60)
    with pytest.raises(TidemapError) as caught:
        client.create_location(name, interval_s=60)
    assert caught.value.status == 409
    with pytest.raises(TidemapError) as caught:
        handle.state()
    assert caught.value.status == 409
    assert caught.value.type.endswith("no-model")
    with pytest.raises(TidemapError) as caught:
        handle.observe([START], [2])
    assert caught.value.status == 422
    assert caught.value.errors
    with pytest.raises(TidemapError) as caught:
        client.create_location("no spaces", interval_s=-1)
    assert {error.field for error in caught.value.errors} >= {"name", "interval_s"}
    assert handle.get().observations == 0


def test_a_time_without_zone_is_refused_before_anything_is_sent(client: Any, name: str) -> None:
    handle = client.create_location(name, interval_s=60)
    with pytest.raises(ValueError, match="no time zone"):
        handle.observe([datetime(2026, 1, 1)], [1])
    assert handle.get().observations == 0


def test_patch_and_delete(client: Any, name: str) -> None:
    sensor = SensorRates(miss=0.1, false_alarm=0.02)
    handle = client.create_location(name, interval_s=60, retention=DAY_S, sensor=sensor)
    assert handle.get().sensor == sensor
    assert handle.patch(name=f"{name}-2", confidence=0.75, retention=None, sensor="learn").confidence == 0.75
    assert (handle.name, handle.get().retention, handle.get().sensor) == (f"{name}-2", None, "learn")
    handle.delete()
    with pytest.raises(TidemapError) as caught:
        handle.get()
    assert caught.value.status == 404


def test_what_was_measured_can_be_deleted(client: Any, name: str) -> None:
    handle = client.create_location(name, interval_s=60, combine="any")
    times = START + 60.0 * np.arange(10)
    for source, later in (("spot", 0.0), ("rover", 3600.0)):
        handle.observe(times + later, np.ones(10), source=source)
    assert handle.delete_observations(START, times[5]).deleted == 5
    assert handle.delete_observations(datetime.fromtimestamp(START, UTC), START + DAY_S, "rover").deleted == 10
    assert handle.get().observations == 5
    assert handle.get().combine == "any"


def test_anomalies_are_snoozed_and_muted(client: Any, name: str) -> None:
    handle = door(client, name)
    day = START + 8 * DAY_S
    (event,) = handle.observe([day + 3600], [1]).anomalies
    later = datetime.now(UTC) + timedelta(hours=1)
    assert client.snooze(event.id, later).snoozed_until == pytest.approx(later.timestamp(), abs=1e-3)
    assert client.snooze(event.id, None).snoozed_until is None
    mute = client.mute(day + 7200, day + 10_800, locations=[name], weekly=True, until=day + 30 * DAY_S, note="x")
    assert (mute.locations, mute.start, mute.weekly, mute.note) == ([name], day + 7200, True, "x")
    (silent,) = handle.observe([day + 7200], [1]).anomalies
    assert mute in client.mutes()
    client.unmute(mute.id)
    assert mute not in client.mutes()
    assert [each.id for each in handle.anomalies(muted=True)] == [silent.id]


def test_anomalies_are_paged_and_acknowledged(client: Any, name: str) -> None:
    handle = door(client, name)
    day = START + 8 * DAY_S
    for hour in (1, 2, 3):
        accepted = handle.observe([day + hour * 3600], [1])
        assert [event.observed for event in accepted.anomalies] == [1]
    found = list(handle.anomalies(limit=2))
    assert [event.start for event in found] == [day + hour * 3600 for hour in (1, 2, 3)]
    assert [event.id for event in handle.anomalies(after=found[0].id)] == [event.id for event in found[1:]]
    detail = client.anomaly(found[1].id)
    assert detail.model_dump(exclude={"reasons"}) == found[1].model_dump()
    assert (detail.reasons.observed, detail.reasons.samples) == (1, 6)
    assert handle.find_confidence(false_alarms_per_week=1000, rule="surprise").confidence == 0.5
    seen = client.acknowledge(found[1].id, "the cleaners")
    assert (seen.id, seen.note) == (found[1].id, "the cleaners")
    assert [event.id for event in handle.anomalies(acknowledged=True)] == [found[1].id]
    computed = handle.detect(day, day + DAY_S, confidence=0.9)
    assert [event.start for event in computed.items] == [event.start for event in found]
    assert computed.items[0].id is None


def test_jobs(client: Any, name: str) -> None:
    handle = client.create_location(name, interval_s=600)
    handle.observe(*daily(3))
    job = handle.update(wait=False, estimator="static")
    assert job.kind == "update"
    until(lambda: client.jobs.get(job.id).state == "done")
    assert job.id in [each.id for each in client.jobs.list()]
    with pytest.raises(TidemapError) as caught:
        client.jobs.cancel(job.id)
    assert caught.value.status == 409


def test_events_tell_what_happens(client: Any, name: str, shared_server: ServerProcess) -> None:
    handle = door(client, name)
    night = START + 8 * DAY_S
    first = handle.observe([night], [1]).anomalies[0]
    messages = client.events(location=name, after=first.id - 1)
    replayed = next(messages)
    assert (replayed.kind, replayed.id, replayed.location) == ("anomaly", first.id, name)
    assert replayed.data["cells"] == [0]
    with Client(shared_server.url) as other:
        other.location(name).observe([night + 600], [0])
        other.location(name).observe([night + 1200], [1])
    kinds = [(message.kind, message.time > 1_700_000_000) for message in (next(messages) for _ in range(3))]
    assert kinds == [("observation", True), ("observation", True), ("anomaly", True)]
    messages.close()


def test_events_of_an_unknown_location_are_refused(client: Any, name: str) -> None:
    with pytest.raises(TidemapError, match=name) as caught:
        next(client.events(location=name))
    assert caught.value.status == 404


def test_the_limit_of_requests_is_waited_out(connect: Callable[..., Any], server: StartServer) -> None:
    process = server(env={"TIDEMAP_VIEWER": "false", "TIDEMAP_REQUESTS_PER_S": "1", "TIDEMAP_REQUESTS_BURST": "5"})
    key = connect(process.url).keys.create("root", "admin").key
    owner = connect(process.url, key=key)
    watcher = owner.keys.create("watcher", "operator").key
    handle = owner.create_location("door", interval_s=60)
    posted = 0
    # However slow the machine is: until one came too soon.
    while not posted or "rate-limit" not in refused(process, watcher):
        for _ in range(6):
            assert not handle.observe([START + 60 * posted], [1]).duplicate
            posted += 1
    assert handle.get().observations == posted


def refused(process: ServerProcess, key: str) -> dict[str, float]:
    """How many requests the server has refused for now, by problem."""
    answer = httpx.get(f"{process.url}/metrics", headers={"Authorization": f"Bearer {key}"}, timeout=WAIT_S)
    assert answer.status_code == 200, answer.text
    found = re.findall(r'^tidemap_refused_total{problem="([a-z-]+)"} ([0-9.]+)$', answer.text, re.MULTILINE)
    return {problem: float(number) for problem, number in found}


def test_keys_open_and_close_doors(connect: Callable[..., Any], server: StartServer) -> None:
    process = server()
    owner = connect(process.url)
    admin = owner.keys.create("root", "admin")
    robot = connect(process.url, key=admin.key).keys.create("spot", "robot")
    with pytest.raises(TidemapError) as caught:
        owner.locations()
    assert caught.value.status == 401
    owner = connect(process.url, key=admin.key)
    owner.create_location("door", interval_s=60)
    spot = connect(process.url, key=robot.key)
    assert spot.location("door").observe([START], [1]).accepted == 1
    owner.create_location("lab", kind="grid2d", interval_s=60, grid={"resolution_m": 1, "shape": [4, 3]})
    assert spot.location("lab").observe_grid(START, occupied=[(2, 2)], free=[(1, 1)]).accepted == 2
    owner.location("lab").update()
    assert owner.location("lab").state(START, observed=True).cell.tolist() == [4, 8]
    with pytest.raises(TidemapError) as caught:
        spot.keys.list()
    assert caught.value.status == 403
    with pytest.raises(TidemapError) as caught:
        next(spot.events())
    assert caught.value.status == 403
    assert {(key.name, key.role) for key in owner.keys.list()} >= {("root", "admin"), ("spot", "robot")}
    owner.keys.delete(robot.id)
    with pytest.raises(TidemapError) as caught:
        spot.location("door").observe([START + 60], [1])
    assert caught.value.status == 401


def test_a_server_killed_under_a_post_costs_nothing(connect: Callable[..., Any], server: StartServer) -> None:
    process = server()
    client = connect(process.url, retry=RetryPolicy(tries=2000, first_s=0.05, max_s=0.2))
    handle = client.create_location("lab", kind="grid2d", interval_s=60, grid={"resolution_m": 1, "shape": [300, 200]})
    times, cells = np.repeat(START + 60 * np.arange(30), 60_000), np.tile(np.arange(60_000), 30)

    def cut_the_power() -> None:
        time.sleep(0.25)
        process.kill()
        process.restart()

    saboteur = threading.Thread(target=cut_the_power)
    saboteur.start()
    accepted = handle.observe(times, cells % 2, cells)
    saboteur.join()
    assert handle.get().observations == len(times)
    assert accepted.last_time == times[-1]


def test_events_survive_a_restart_and_miss_no_anomaly(connect: Callable[..., Any], server: StartServer) -> None:
    process = server()
    client = connect(process.url, retry=RetryPolicy(tries=2000, first_s=0.05, max_s=0.2))
    handle = door(client, "door")
    nights = START + (8 + np.arange(3)) * DAY_S
    known = handle.observe(nights[:1], [1]).anomalies[0].id
    messages = client.events(kind="anomaly", after=known - 1)
    assert next(messages).id == known
    process.restart()
    with Client(process.url) as other:
        missed = [other.location("door").observe([night], [1]).anomalies[0].id for night in nights[1:]]
    assert [next(messages).id for _ in missed] == missed
    messages.close()
