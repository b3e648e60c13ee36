"""Updates: what is fitted, what becomes visible, and what does not when something goes wrong."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.contexts import NOW, Clock, Serial, history_of, make_location, post_rows, post_states, refit
from tidemap.errors import DomainError, InvalidInputError, LocationNotFoundError, NoModelError
from tidemap.history.history import UNOBSERVED
from tidemap.services.context import Context
from tidemap.services.locations import delete_location, find_location, get_location
from tidemap.services.spectra import current_revision, fitted
from tidemap.services.state import StateQuery, state_at
from tidemap.services.update import UpdateRequest, run_update
from tidemap.spectral.prediction import predict_slow

MINUTE, DAY = 60.0, 86_400.0


def make_door(ctx: Context, days: float = 3, **form: Any) -> None:
    """Open from eight to noon, every minute of so many days; a little noise."""
    make_location(ctx, "door", **form)
    time = np.arange(0.0, days * DAY, MINUTE)
    noise = np.random.default_rng(1).random(len(time)) < 0.02
    post_states(ctx, "door", time, ((time % DAY >= 8 * 3600) & (time % DAY < 12 * 3600)) ^ noise)


def test_a_revision_says_what_it_is(ctx: Context, clock: Clock) -> None:
    make_door(ctx, estimator="fft", order=4)
    clock.now += 5
    record = refit(ctx, "door")
    assert (record.revision, record.estimator, record.order) == (1, "fft", 4)
    assert (record.start, record.stop) == (0, 3 * 1440)
    assert (record.observation_seq, record.measurements, record.updated_at) == (1, 3 * 1440, NOW + 5)
    stored = current_revision(ctx, "door")[1]
    assert stored.persistence.as_dict() == record.persistence.as_dict()
    assert replace(stored, persistence=record.persistence) == record
    shown = get_location(ctx, "door")
    assert (shown.revision, shown.updated_at, shown.accuracy) == (1, NOW + 5, record.accuracy)
    assert refit(ctx, "door").revision == 2


def test_accuracy_is_the_share_of_samples_that_the_model_had_right(ctx: Context) -> None:
    make_door(ctx, estimator="fft")
    for order in (1, 5):
        record = refit(ctx, "door", order=order)
        states = history_of(ctx, "door", 0, 0, 3 * 1440).states()[0]
        seen = states != UNOBSERVED
        p = predict_slow(fitted(ctx, "door").spectrum, np.arange(3 * 1440) * MINUTE)[0]
        assert record.accuracy == pytest.approx(np.mean((p > 0.5)[seen] == states[seen]), abs=1e-3)


@pytest.mark.parametrize(
    ("request_", "window"),
    [
        # Whole days at the end, for the day's frequency to fall on a bin.
        ({}, (720, 3 * 1440 + 720)),
        ({"start": DAY}, (1440, 3 * 1440 + 720)),
        ({"stop": DAY + 59.0}, (0, 1440)),
        ({"start": DAY, "stop": 2 * DAY}, (1440, 2 * 1440)),
        ({"start": -9e9, "stop": 1e9}, (0, 3 * 1440 + 720)),
    ],
)
def test_the_window_is_what_was_asked_for_or_whole_days(
    ctx: Context, request_: dict[str, float], window: tuple[int, int]
) -> None:
    make_door(ctx, 3.5, estimator="fft", order=2)
    record = refit(ctx, "door", **request_)
    assert (record.start, record.stop) == window


@pytest.mark.parametrize(
    "request_", [{"start": 9 * DAY}, {"stop": -DAY}, {"start": DAY, "stop": DAY}, {"start": 2 * DAY, "stop": DAY}]
)
def test_an_empty_window_is_refused(ctx: Context, request_: dict[str, float]) -> None:
    make_door(ctx, 1)
    with pytest.raises(InvalidInputError, match="nothing was observed between start and stop"):
        refit(ctx, "door", **request_)
    assert find_location(ctx, "door").revision == 0


def test_there_is_nothing_to_fit_without_observations(ctx: Context) -> None:
    with pytest.raises(LocationNotFoundError):
        refit(ctx, "door")
    make_location(ctx, "door")
    with pytest.raises(InvalidInputError, match="no observations yet"):
        refit(ctx, "door")


@pytest.mark.parametrize(
    ("form", "request_", "chosen"),
    [
        ({"estimator": "fft", "order": 3}, {}, ("fft", 3)),
        ({"estimator": "fft", "order": 3}, {"order": 7}, ("fft", 7)),
        ({"estimator": "fft", "order": 3}, {"estimator": "static"}, ("static", 0)),
        ({"estimator": "static"}, {}, ("static", 0)),
        ({"estimator": "static", "order": 5}, {}, ("static", 0)),
        ({"estimator": "static"}, {"estimator": "fft", "order": 2}, ("fft", 2)),
    ],
)
def test_the_request_goes_before_the_location(
    ctx: Context, form: dict[str, Any], request_: dict[str, Any], chosen: tuple[str, int]
) -> None:
    make_door(ctx, 2, **form)
    record = refit(ctx, "door", **request_)
    assert (record.estimator, record.order) == chosen
    assert record.selection is None


@pytest.mark.parametrize(("form", "request_"), [({}, {}), ({"estimator": "fft", "order": 9}, {"estimator": "auto"})])
def test_auto_says_what_it_chose_and_why(ctx: Context, form: dict[str, Any], request_: dict[str, Any]) -> None:
    make_door(ctx, 6, **form)
    record = refit(ctx, "door", **request_)
    assert record.selection is not None
    assert (record.selection["estimator"], record.selection["order"]) == (record.estimator, record.order)
    assert record.estimator != "static"
    assert record.selection["reason"]
    scores = {(row["estimator"], row["order"]): row["log_loss"] for row in record.selection["scores"]}
    assert scores["static", 0] > scores[record.estimator, record.order]


def test_auto_with_too_little_history_says_so_and_takes_the_mean(ctx: Context) -> None:
    make_door(ctx, 1)
    record = refit(ctx, "door")
    assert (record.estimator, record.order) == ("static", 0)
    assert record.selection is not None
    assert "less than 2 days" in record.selection["reason"]


def test_auto_chooses_the_order_of_the_estimator_that_was_asked_for(ctx: Context) -> None:
    make_door(ctx, 6, estimator="fft")
    record = refit(ctx, "door")
    assert record.estimator == "fft"
    assert record.order >= 1
    assert record.selection is not None


def test_progress_goes_up_to_one(ctx: Context) -> None:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(0.0, 7, 1)])
    told: list[float] = []
    run_update(ctx, find_location(ctx, "lab").id, UpdateRequest(estimator="static"), Serial(ctx), told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.1, 1.0)
    assert len(told) == 5


class Interrupting(Serial):
    """Does something between two chunks."""

    def __init__(self, ctx: Context, act: Any) -> None:
        super().__init__(ctx)
        self.act = act

    def map(self, run: Any, items: Any) -> Any:
        for i, item in enumerate(items):
            if i == 1:
                self.act()
            yield run(self.ctx, item)


def make_lab(ctx: Context) -> None:
    make_location(ctx, "lab", (80, 40))
    post_rows(ctx, "lab", [(MINUTE * n, cell, n % 2) for n in range(4) for cell in (7, 1500, 3000)])


def interrupted(ctx: Context, act: Any) -> None:
    run_update(
        ctx, find_location(ctx, "lab").id, UpdateRequest(estimator="static"), Interrupting(ctx, act), lambda _: None
    )


def test_nothing_of_an_update_is_visible_before_its_end(ctx: Context) -> None:
    make_lab(ctx)
    seen: list[int] = []

    def look() -> None:
        with pytest.raises(NoModelError):
            state_at(ctx, "lab", StateQuery(0.0))
        seen.append(find_location(ctx, "lab").revision)

    interrupted(ctx, look)
    assert seen == [0]
    assert state_at(ctx, "lab", StateQuery(0.0)).cell.tolist() == [7, 1500, 3000]


def test_an_update_that_failed_on_the_way_leaves_the_model_as_it_was(ctx: Context) -> None:
    make_lab(ctx)
    refit(ctx, "lab", estimator="static")

    def fail() -> None:
        raise ArithmeticError("on the way")

    with pytest.raises(ArithmeticError):
        interrupted(ctx, fail)
    assert state_at(ctx, "lab", StateQuery(0.0)).revision == 1
    assert refit(ctx, "lab", estimator="static").revision == 3
    assert state_at(ctx, "lab", StateQuery(0.0)).revision == 3


def test_what_is_posted_during_an_update_belongs_to_the_next(ctx: Context) -> None:
    make_lab(ctx)
    interrupted(ctx, lambda: post_rows(ctx, "lab", [(MINUTE * 9, 7, 1)]))
    location, revision = current_revision(ctx, "lab")
    assert (location.observation_seq, revision.observation_seq) == (2, 1)
    assert (location.measurements, revision.measurements) == (13, 12)


def test_a_post_between_the_compaction_and_the_plan_waits_for_the_next_update_too(ctx: Context) -> None:
    make_lab(ctx)
    posted: list[float] = []

    def post(progress: float) -> None:
        if not posted:
            posted.append(progress)
            post_rows(ctx, "lab", [(MINUTE * 9, 3000, 1)])

    run_update(ctx, find_location(ctx, "lab").id, UpdateRequest(estimator="static"), Serial(ctx), post)
    _, revision = current_revision(ctx, "lab")
    assert (revision.stop, revision.observation_seq, revision.measurements) == (4, 1, 12)
    assert state_at(ctx, "lab", StateQuery(0.0)).probability.tolist() == [0.5, 0.5, 0.5]
    assert history_of(ctx, "lab", 2, 9, 10).states()[3000 - 2048] == 1, "it is known all the same"


def test_a_location_deleted_during_its_update_is_gone(ctx: Context) -> None:
    make_lab(ctx)
    with pytest.raises(DomainError):
        interrupted(ctx, lambda: delete_location(ctx, "lab"))
    make_lab(ctx)
    assert find_location(ctx, "lab").revision == 0
    assert refit(ctx, "lab", estimator="static").revision == 1


def test_a_location_made_anew_during_an_update_does_not_get_it(ctx: Context) -> None:
    make_lab(ctx)

    def renew() -> None:
        delete_location(ctx, "lab")
        make_location(ctx, "lab", (80, 40))
        post_rows(ctx, "lab", [(0.0, 5, 1)])

    with pytest.raises(DomainError):
        interrupted(ctx, renew)
    assert find_location(ctx, "lab").revision == 0
    refit(ctx, "lab", estimator="static")
    assert state_at(ctx, "lab", StateQuery(0.0)).cell.tolist() == [5]


def test_of_two_updates_at_once_one_whole_model_is_left(ctx: Context) -> None:
    make_lab(ctx)
    refit(ctx, "lab", estimator="static")

    def update(n: int) -> bool:
        try:
            refit(ctx, "lab", estimator="fft", order=1 + n)
        except DomainError:
            return False
        return True

    with ThreadPoolExecutor(4) as pool:
        assert any(pool.map(update, range(4)))
    view = state_at(ctx, "lab", StateQuery(0.0))
    assert view.cell.tolist() == [7, 1500, 3000]
    assert view.revision == find_location(ctx, "lab").revision > 1
