"""Locations: what a change changes, and what it leaves."""

from dataclasses import asdict
from typing import Any

import pytest

from tests.support.contexts import NOW, make_location, opened, post_states, refit
from tidemap.api.views.locations import location_changes
from tidemap.errors import InvalidInputError, LocationExistsError, LocationNotFoundError
from tidemap.schemas.locations import LocationPatch
from tidemap.services.context import Context
from tidemap.services.locations import change_location, delete_location, get_location, list_locations


def change(ctx: Context, which: str, /, **fields: Any) -> dict[str, Any]:
    return asdict(change_location(ctx, which, location_changes(LocationPatch(**fields))))


def test_a_new_location_shows_what_was_asked_for(ctx: Context) -> None:
    made = make_location(ctx, "lab", (4, 3, 2), epoch=-7.5, order=5, retention=1e6, time_zone="Europe/London")
    assert made == get_location(ctx, "lab") == list_locations(ctx)[0]
    assert (made.kind, made.cells.shape, made.epoch, made.order, made.retention_s) == (
        "grid3d",
        (4, 3, 2),
        -7.5,
        5,
        1e6,
    )
    assert (made.created_at, made.measurements, made.revision, made.accuracy) == (NOW, 0, 0, None)


def test_a_change_leaves_what_it_does_not_name(ctx: Context) -> None:
    before = asdict(make_location(ctx, "door", order=5, retention=100.0))
    assert change(ctx, "door") == before
    assert change(ctx, "door", confidence=0.7) == before | {"confidence": 0.7}
    assert change(ctx, "door", order="auto", retention=None) == before | {
        "confidence": 0.7,
        "order": None,
        "retention_s": None,
    }


@pytest.mark.parametrize("field", ["name", "time_zone", "estimator", "order", "confidence", "missing", "min_cells"])
def test_null_is_refused_where_there_must_be_a_value(ctx: Context, field: str) -> None:
    before = asdict(make_location(ctx, "door"))
    with pytest.raises(InvalidInputError) as caught:
        change(ctx, "door", **{field: None, "retention": 5.0})
    assert caught.value.errors[0].field == field
    assert asdict(get_location(ctx, "door")) == before


def test_hold_needs_its_seconds(ctx: Context) -> None:
    before = asdict(make_location(ctx, "door"))
    with pytest.raises(InvalidInputError, match="hold_s"):
        change(ctx, "door", missing="hold", name="gate")
    assert asdict(get_location(ctx, "door")) == before
    change(ctx, "door", missing="hold", hold_s=60.0)
    with pytest.raises(InvalidInputError, match="hold_s"):
        change(ctx, "door", hold_s=None)
    assert change(ctx, "door", missing="mask", hold_s=None)["missing"] == "mask"


def test_a_renamed_location_keeps_everything(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    make_location(ctx, "gate")
    post_states(ctx, "door", [0.0], [1])
    refit(ctx, "door")
    with pytest.raises(LocationExistsError):
        change(ctx, "door", name="gate")
    before = asdict(get_location(ctx, "door"))
    assert change(ctx, "door", name="front-door") == before | {"name": "front-door"}
    with pytest.raises(LocationNotFoundError):
        get_location(ctx, "door")
    make_location(ctx, "door")
    assert [location.name for location in list_locations(ctx)] == ["door", "front-door", "gate"]
    assert get_location(ctx, "door").revision == 0


def test_a_location_larger_than_the_server_allows_is_refused(database_url: str) -> None:
    with opened(database_url, max_cells=12) as ctx:
        make_location(ctx, "fits", (4, 3))
        with pytest.raises(InvalidInputError, match="13 cells are more than this server's 12"):
            make_location(ctx, "lab", (13, 1))


def test_open_anomalies_are_counted(ctx: Context) -> None:
    make_location(ctx, "door", estimator="static")
    post_states(ctx, "door", [60.0 * n for n in range(50)], [0] * 50)
    refit(ctx, "door")
    post_states(ctx, "door", [6000.0, 7200.0], [1, 1])
    assert get_location(ctx, "door").open_anomalies == list_locations(ctx)[0].open_anomalies == 2


def test_a_deleted_location_is_gone(ctx: Context) -> None:
    make_location(ctx, "door")
    delete_location(ctx, "door")
    assert list_locations(ctx) == []
    for act in (delete_location, get_location):
        with pytest.raises(LocationNotFoundError):
            act(ctx, "door")
