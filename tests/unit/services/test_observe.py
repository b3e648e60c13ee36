"""Observe: stored once, judged by what was expected, told after it is durable."""

import numpy as np
import pytest

from app.errors import (
    IdempotencyConflictError,
    InvalidInputError,
    LocationNotFoundError,
    QueueFullError,
    StorageUnavailableError,
    UnsupportedMediaTypeError,
)
from app.events.messages import Message
from app.ingest.observation import JSON, Body
from app.services.anomalies import EventQuery, list_events
from app.services.context import Context
from app.services.locations import find_location, get_location
from app.services.observe import Post, observe
from tests.support.contexts import NOW, history_of, make_location, post_rows, post_states, refit


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
    assert (shown.observations, shown.first_time, shown.last_time) == (3, 0.5, 300.0)


def test_a_key_stores_once_whatever_happens_between(ctx: Context) -> None:
    learned_door(ctx)
    first = post_states(ctx, "door", [6000.0], [1], idempotency_key="k")
    assert len(first.anomalies) == 1
    refit(ctx, "door")
    again = post_states(ctx, "door", [6000.0], [1], idempotency_key="k")
    assert (again.duplicate, again.accepted, again.anomalies, again.revision) == (True, 0, [], 2)
    assert get_location(ctx, "door").observations == 101
    assert len(list_events(ctx, EventQuery())) == 1


def test_a_key_with_another_body_is_a_conflict_and_stores_nothing(ctx: Context) -> None:
    make_location(ctx, "door")
    post_states(ctx, "door", [0.0], [1], idempotency_key="k")
    with pytest.raises(IdempotencyConflictError):
        post_states(ctx, "door", [0.0], [0], idempotency_key="k")
    with pytest.raises(IdempotencyConflictError):
        observe(ctx, "door", Post(Body(b"not even JSON", JSON), None, "k"))
    assert get_location(ctx, "door").observations == 1


@pytest.mark.parametrize(
    ("body", "error"),
    [
        (Body(b'{"time": [1], "state": [2]}', JSON), InvalidInputError),
        (Body(b'{"time": [99999999999], "state": [1]}', JSON), InvalidInputError),
        (Body(b"1;1", "text/csv"), UnsupportedMediaTypeError),
    ],
)
def test_a_refused_post_stores_nothing_and_keeps_its_key_free(ctx: Context, body: Body, error) -> None:
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
    assert (event.probability, event.surprise, event.confidence, event.rule) == (0.0, 1.0, 0.9, "surprise")
    assert event.revision == answer.revision == 1
    assert [each.id for each in list_events(ctx, EventQuery())] == [event.id]


def test_an_event_is_a_connected_group_of_cells_and_samples(ctx: Context) -> None:
    make_location(ctx, "lab", (6, 6), estimator="static")
    post_rows(ctx, "lab", [(60.0 * n, cell, 0) for n in range(10) for cell in range(36)])
    refit(ctx, "lab")
    seen = [(0, 7), (0, 14), (0, 35), (1, 14), (3, 14)]
    answer = post_rows(ctx, "lab", [(600.0 + 60.0 * n, cell, 1) for n, cell in seen])
    assert [(event.start, event.stop, event.cells) for event in answer.anomalies] == [
        (600.0, 720.0, [7, 14]),
        (600.0, 660.0, [35]),
        (780.0, 840.0, [14]),
    ]
    assert answer.anomalies[0].bbox == [0.5, 0.5, 0.0, 1.5, 1.5, 0.5]


def test_small_groups_are_left_out_where_a_location_says_so(ctx: Context) -> None:
    make_location(ctx, "lab", (6, 6), estimator="static", min_cells=2)
    post_rows(ctx, "lab", [(60.0 * n, cell, 0) for n in range(10) for cell in range(36)])
    refit(ctx, "lab")
    answer = post_rows(ctx, "lab", [(600.0, cell, 1) for cell in (7, 14, 35)])
    assert [event.cells for event in answer.anomalies] == [[7, 14]]


def test_nothing_is_told_before_it_is_durable(ctx: Context) -> None:
    learned_door(ctx)
    heard: list[tuple[Message, int, list[int | None]]] = []

    def listen(message: Message) -> None:
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
    heard: list[Message] = []
    ctx.bus.subscribe(heard.append)

    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr("app.storage.store.Store.submit", refuse)
    with pytest.raises(type(error)):
        post_states(ctx, "door", [0.0], [1])
    assert heard == []


def test_times_of_all_signs_and_fractions_fall_into_their_samples(ctx: Context) -> None:
    make_location(ctx, "door", interval_s=0.25, epoch=0.125)
    post_states(ctx, "door", [-0.125, 0.0, 0.125, 0.374, 0.375], [1, 0, 1, 1, 0])
    assert history_of(ctx, "door", 0, -2, 3).states().tolist() == [[2, 0, 1, 0, 2]]
