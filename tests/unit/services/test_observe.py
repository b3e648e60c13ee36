"""Observe: stored once, judged by what was expected, told after it is durable."""

import asyncio
from concurrent.futures import wait
from threading import Event

import numpy as np
import pytest

from tests.support.contexts import NOW, history_of, make_location, post_rows, post_states, refit
from tests.support.truth import share
from tests.support.waiting import WAIT_S
from tidemap.errors import (
    DomainError,
    IdempotencyConflictError,
    InvalidInputError,
    LocationNotFoundError,
    QueueFullError,
    StorageUnavailableError,
    UnauthorizedError,
    UnsupportedMediaTypeError,
)
from tidemap.events.messages import EventMessage
from tidemap.formats.registry import Body
from tidemap.media_types import JSON
from tidemap.services.anomalies import EventQuery, list_events
from tidemap.services.context import Context
from tidemap.services.keys import Claim, Principal
from tidemap.services.locations import LocationChanges, change_location, delete_location, find_location, get_location
from tidemap.services.observe import (
    QUICK_BYTES,
    QUICK_SNAPSHOTS,
    NotQuickError,
    begin,
    begin_quick,
    is_quick,
    observe,
    submit,
)
from tidemap.services.posts import Post
from tidemap.services.spectra import fitted


def learned_door(ctx: Context) -> None:
    """A door that was closed for a hundred minutes."""
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", np.arange(100) * 60.0, np.zeros(100))
    refit(ctx, "door")


def test_an_answer_says_what_was_stored(ctx: Context) -> None:
    make_location(ctx, "door")
    answer = post_states(ctx, "door", [300.0, 0.5, 120.0], [1, 0, 1])
    assert (answer.accepted, answer.first_time, answer.last_time) == (3, 0.5, 300.0)
    assert (answer.duplicate, answer.anomalies, answer.revision) == (False, [], 0)
    shown = get_location(ctx, "door")
    assert (shown.measurements, shown.first_time, shown.last_time) == (3, 0.5, 300.0)


def test_a_key_stores_once_whatever_happens_between(ctx: Context) -> None:
    learned_door(ctx)
    first = post_states(ctx, "door", [6000.0], [1], idempotency_key="k")
    assert len(first.anomalies) == 1
    refit(ctx, "door")
    again = post_states(ctx, "door", [6000.0], [1], idempotency_key="k")
    assert (again.duplicate, again.accepted, again.anomalies, again.revision) == (True, 0, [], 2)
    assert get_location(ctx, "door").measurements == 101
    assert len(list_events(ctx, EventQuery())) == 1


def test_a_key_with_another_body_is_a_conflict_and_stores_nothing(ctx: Context) -> None:
    make_location(ctx, "door")
    post_states(ctx, "door", [0.0], [1], idempotency_key="k")
    with pytest.raises(IdempotencyConflictError):
        post_states(ctx, "door", [0.0], [0], idempotency_key="k")
    with pytest.raises(IdempotencyConflictError):
        observe(ctx, "door", Post(Body(b"not even JSON", JSON), None, "k"))
    assert get_location(ctx, "door").measurements == 1


@pytest.mark.parametrize(
    ("body", "error"),
    [
        (Body(b'{"time": [1], "state": [2]}', JSON), InvalidInputError),
        (Body(b'{"time": [99999999999], "state": [1]}', JSON), InvalidInputError),
        (Body(b"1;1", "text/csv"), UnsupportedMediaTypeError),
    ],
)
def test_a_refused_post_stores_nothing_and_keeps_its_key_free(
    ctx: Context, body: Body, error: type[DomainError]
) -> None:
    make_location(ctx, "door")
    with pytest.raises(error):
        observe(ctx, "door", Post(body, None, "k"))
    assert find_location(ctx, "door").observation_seq == 0
    assert post_states(ctx, "door", [0.0], [1], idempotency_key="k").accepted == 1


def test_a_measurement_may_be_a_little_ahead_of_the_clock(ctx: Context) -> None:
    make_location(ctx, "door")
    ahead = NOW + ctx.settings.future_s
    assert post_states(ctx, "door", [ahead], [1]).accepted == 1
    with pytest.raises(InvalidInputError, match="too far in the future"):
        post_states(ctx, "door", [ahead + 1], [1])


def test_an_unknown_location_is_said_to_be_unknown(ctx: Context) -> None:
    with pytest.raises(LocationNotFoundError):
        post_states(ctx, "attic", [0.0], [1])


def test_only_what_stands_in_a_sample_is_judged(ctx: Context) -> None:
    learned_door(ctx)
    answer = post_states(ctx, "door", [6000.0, 6030.0, 6060.0, 6090.0], [1, 0, 0, 1])
    (event,) = answer.anomalies
    assert (event.start, event.stop, event.observed) == (6060.0, 6120.0, 1)
    assert event.probability == pytest.approx(share(0, 100))
    assert event.surprise == pytest.approx(share(100, 100))
    assert (event.confidence, event.rule) == (0.9, "surprise")
    assert event.revision == answer.revision == 1
    assert [each.id for each in list_events(ctx, EventQuery())] == [event.id]


def test_an_event_is_a_connected_group_of_cells_and_samples(ctx: Context) -> None:
    make_location(ctx, "lab", (6, 6), estimator="static")
    post_rows(ctx, "lab", [(60.0 * n, cell, 0) for n in range(10) for cell in range(36)])
    refit(ctx, "lab")
    seen = [(0, 7), (0, 14), (0, 35), (1, 14), (3, 14)]
    answer = post_rows(ctx, "lab", [(600.0 + 60.0 * n, cell, 1) for n, cell in seen])
    assert [(event.start, event.stop, event.cells.tolist()) for event in answer.anomalies] == [
        (600.0, 720.0, [7, 14]),
        (600.0, 660.0, [35]),
        (780.0, 840.0, [14]),
    ]
    assert answer.anomalies[0].bbox == (0.5, 0.5, 0.0, 1.5, 1.5, 0.5)


def test_small_groups_are_left_out_where_a_location_says_so(ctx: Context) -> None:
    make_location(ctx, "lab", (6, 6), estimator="static", min_cells=2)
    post_rows(ctx, "lab", [(60.0 * n, cell, 0) for n in range(10) for cell in range(36)])
    refit(ctx, "lab")
    answer = post_rows(ctx, "lab", [(600.0, cell, 1) for cell in (7, 14, 35)])
    assert [event.cells.tolist() for event in answer.anomalies] == [[7, 14]]


def test_nothing_is_told_before_it_is_durable(ctx: Context) -> None:
    learned_door(ctx)
    heard: list[tuple[EventMessage, int, list[int]]] = []

    def listen(message: EventMessage) -> None:
        events = [event.id for event in list_events(ctx, EventQuery())]
        heard.append((message, find_location(ctx, "door").observation_seq, events))

    ctx.bus.subscribe(listen)
    post_states(ctx, "door", [6000.0], [1], source="r2")
    assert [(message.kind, message.id, stored, events) for message, stored, events in heard] == [
        ("observation", 2, 2, [1]),
        ("anomaly", 1, 2, [1]),
    ]
    assert heard[0][0].data == {"measurements": 1, "source": "r2", "last_time": 6000.0}


@pytest.mark.parametrize("error", [QueueFullError(), StorageUnavailableError()])
def test_what_could_not_be_stored_is_not_told(ctx: Context, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    make_location(ctx, "door")
    heard: list[EventMessage] = []
    ctx.bus.subscribe(heard.append)

    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr("tidemap.storage.store.Store.submit_item", refuse)
    with pytest.raises(type(error)):
        post_states(ctx, "door", [0.0], [1])
    assert heard == []


def test_times_of_all_signs_and_fractions_fall_into_their_samples(ctx: Context) -> None:
    make_location(ctx, "door", interval_s=0.25, epoch=0.125)
    post_states(ctx, "door", [-0.125, 0.0, 0.125, 0.374, 0.375], [1, 0, 1, 1, 0])
    assert history_of(ctx, "door", 0, -2, 3).states().tolist() == [[2, 0, 1, 0, 2]]


def opened(time_s: float, key: str | None, claim: Claim | None = None) -> Post:
    return Post(Body(b'{"time": [%.1f], "state": [1]}' % time_s, JSON), None, key, claim)


def test_a_post_is_quick_where_it_is_small_and_its_model_is_in_memory(ctx: Context) -> None:
    post = opened(6000.0, None)
    make_location(ctx, "gate")
    assert not is_quick(ctx, "gate", post), "a location that was never posted to"
    observe(ctx, "gate", post)
    assert is_quick(ctx, "gate", post), "one without a model"
    learned_door(ctx)
    observe(ctx, "door", post)
    assert is_quick(ctx, "door", post)
    ctx.caches.spectra.drop(lambda _: True)
    assert not is_quick(ctx, "door", post), "a model that would have to be read"
    observe(ctx, "door", post)
    refit(ctx, "door")
    assert not is_quick(ctx, "door", post), "a model that is another now"
    large = Post(Body(bytes(QUICK_BYTES // 40 + 1), JSON))
    assert not is_quick(ctx, "gate", large)


def test_a_quick_post_is_stored_told_and_refused_as_any_other(ctx: Context) -> None:
    learned_door(ctx)
    fitted(ctx, "door")
    heard: list[tuple[str, int]] = []
    ctx.bus.subscribe(lambda message: heard.append((message.kind, message.id)))
    odd = Post(Body(b'{"time": [1], "state": [7]}', JSON))
    stranger = Claim(Principal("gone", "robot", 7), b"nobody's")
    posts = [opened(6000.0, "k"), odd, opened(6060.0, None), opened(6000.0, "k"), opened(7000.0, None, stranger)]
    go_on = Event()
    ctx.store.submit(lambda _: go_on.wait(WAIT_S))
    futures = [begin_quick(ctx, "door", post) for post in posts]
    gone = begin_quick(ctx, "nowhere", opened(0.0, None))
    go_on.set()
    refused = [type(future.exception(WAIT_S)) for future in [*futures, gone]]
    nothing = type(None)
    assert refused == [nothing, InvalidInputError, nothing, nothing, UnauthorizedError, LocationNotFoundError]
    assert [len(futures[i].result().anomalies) for i in (0, 2, 3)] == [1, 1, 0]
    assert futures[3].result().duplicate
    assert heard == [("observation", 2), ("anomaly", 1), ("observation", 3), ("anomaly", 2)]
    assert find_location(ctx, "door").observation_seq == 3


def test_a_post_of_many_moments_is_not_quick_and_nothing_of_it_is_stored(ctx: Context) -> None:
    learned_door(ctx)
    times = [6000.0 + 60 * i for i in range(QUICK_SNAPSHOTS + 1)]
    post = Post(Body(f'{{"time": {times}, "state": {[1] * len(times)}}}'.encode(), JSON))
    with pytest.raises(NotQuickError):
        begin_quick(ctx, "door", post).result(WAIT_S)
    assert find_location(ctx, "door").observation_seq == 1
    assert begin(ctx, "door", post).result(WAIT_S).accepted == len(times)


def test_no_write_waits_for_a_model_that_another_process_has_made(ctx: Context) -> None:
    learned_door(ctx)
    observe(ctx, "door", opened(6000.0, None))
    refit(ctx, "door")
    with pytest.raises(NotQuickError):
        begin_quick(ctx, "door", opened(6060.0, None)).result(WAIT_S)
    assert begin(ctx, "door", opened(6060.0, None)).result(WAIT_S).revision == 2
    assert begin_quick(ctx, "door", opened(6120.0, None)).result(WAIT_S).revision == 2


def test_of_posts_in_one_group_only_those_that_are_wrong_are_refused(ctx: Context) -> None:
    learned_door(ctx)
    make_location(ctx, "gate")
    make_location(ctx, "attic")
    stranger = Claim(Principal("gone", "robot", 7), b"nobody's")
    post_states(ctx, "door", [5000.0], [0], idempotency_key="old")
    posts = [
        ("door", opened(6000.0, "new")),
        ("attic", opened(60.0, None)),
        ("door", opened(6000.0, "new")),
        ("gate", opened(60.0, "new")),
        ("door", opened(6060.0, "new")),
        ("door", opened(6120.0, "old")),
        ("door", opened(6180.0, None, stranger)),
        ("door", opened(6240.0, None)),
    ]
    go_on = Event()
    ctx.store.submit(lambda _: go_on.wait(WAIT_S))
    deleted = ctx.store.submit(lambda work: work.locations.delete("attic"))
    futures = [begin(ctx, name, post) for name, post in posts]
    go_on.set()
    wait(futures, WAIT_S)
    wait([deleted], WAIT_S)
    refused = [type(future.exception()) for future in futures]
    assert refused == [
        type(None),
        LocationNotFoundError,
        type(None),
        type(None),
        IdempotencyConflictError,
        IdempotencyConflictError,
        UnauthorizedError,
        type(None),
    ]
    first, again, gate, last = (futures[n].result() for n in (0, 2, 3, 7))
    assert (first.number, len(first.anomalies), again.duplicate, again.anomalies) == (3, 1, True, [])
    assert (gate.location, gate.number, last.number, len(last.anomalies)) == ("gate", 1, 4, 1)
    assert get_location(ctx, "door").measurements == 103
    stored = list_events(ctx, EventQuery())
    assert [event.id for event in stored] == [first.anomalies[0].id, last.anomalies[0].id]


def test_events_of_one_group_are_told_in_the_order_of_their_ids(ctx: Context) -> None:
    """A client that resumes behind its last event misses none, whichever location is older."""
    for name in ("door", "gate"):
        make_location(ctx, name, estimator="static")
        post_states(ctx, name, np.arange(100) * 60.0, np.zeros(100))
        refit(ctx, name)
    heard: list[EventMessage] = []
    ctx.bus.subscribe(lambda message: heard.append(message) if message.kind == "anomaly" else None)
    go_on = Event()
    ctx.store.submit(lambda _: go_on.wait(WAIT_S))
    futures = [begin(ctx, name, opened(6000.0, None)) for name in ("gate", "door", "gate")]
    go_on.set()
    wait(futures, WAIT_S)
    assert [message.location for message in heard] == ["gate", "door", "gate"]
    assert [message.id for message in heard] == sorted(message.id for message in heard)


def test_a_post_goes_by_what_its_location_is_now(ctx: Context) -> None:
    """Locations are remembered between posts; whatever changes one is noticed by the next."""
    learned_door(ctx)
    assert len(post_states(ctx, "door", [6000.0], [1]).anomalies) == 1
    change_location(ctx, "door", LocationChanges(estimator="fft", confidence=0.5))
    assert post_states(ctx, "door", [6060.0], [1]).anomalies[0].confidence == 0.5
    refit(ctx, "door")
    assert post_states(ctx, "door", [6120.0], [1]).revision == 2
    change_location(ctx, "door", LocationChanges(name="gate"))
    with pytest.raises(LocationNotFoundError):
        post_states(ctx, "door", [6180.0], [1])
    assert post_states(ctx, "gate", [6180.0], [1]).location == "gate"
    delete_location(ctx, "gate")
    with pytest.raises(LocationNotFoundError):
        post_states(ctx, "gate", [6240.0], [1])
    make_location(ctx, "gate")
    assert post_states(ctx, "gate", [6240.0], [1]).number == 1


def test_submit_takes_quick_and_slow_posts_to_their_durable_end(ctx: Context) -> None:
    make_location(ctx, "gate")
    slow, quick = opened(0.0, None), opened(60.0, None)
    assert not is_quick(ctx, "gate", slow)
    assert asyncio.run(submit(ctx, "gate", slow)).number == 1
    assert is_quick(ctx, "gate", quick)
    assert asyncio.run(submit(ctx, "gate", quick)).number == 2
    times = [120.0 + 60 * i for i in range(QUICK_SNAPSHOTS + 1)]
    many = Post(Body(f'{{"time": {times}, "state": {[1] * len(times)}}}'.encode(), JSON))
    assert is_quick(ctx, "gate", many), "only its parsing shows that it is not"
    assert asyncio.run(submit(ctx, "gate", many)).accepted == QUICK_SNAPSHOTS + 1
