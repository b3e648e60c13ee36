"""Doors and rooms of a building in both databases: which stand in a frame, and the state of each at a time."""

from dataclasses import replace

import numpy as np

from tests.support.contexts import NOW, make_location, post_states, refit
from tidemap.history.history import UNOBSERVED
from tidemap.scope import Scope
from tidemap.services.building import posed_at, posed_models
from tidemap.services.context import Context
from tidemap.services.locations import delete_location
from tidemap.services.spectra import Fitted, fitted
from tidemap.spectral.prediction import predict

AT = {"frame": "building", "position": [1.0, 2.0, 0.5]}


def make_door(ctx: Context, name: str, pose: dict[str, object] | None = None) -> None:
    """Closed in one half of each hour and open in the other, for a day."""
    make_location(ctx, name, pose=pose or AT)
    time = NOW - 86400 + 60.0 * np.arange(1440)
    post_states(ctx, name, time, (np.arange(1440) // 30) % 2)


def test_what_stands_in_a_frame_has_the_state_of_its_model_and_as_it_was_seen(ctx: Context) -> None:
    make_door(ctx, "door")
    refit(ctx, "door", estimator="fft", order=3)
    make_door(ctx, "gate", {"frame": "yard", "position": [0, 0, 0]})
    make_door(ctx, "hatch")
    make_location(ctx, "new", pose=AT)
    make_location(ctx, "nowhere")
    make_location(ctx, "room", (2, 2))

    models = posed_models(ctx, "building")
    assert [model.location.name for model in models] == ["door", "hatch", "new"]
    assert [model.location.name for model in posed_models(ctx, "building", Scope(("new",)))] == ["new"]
    for time, seen in ((NOW, 1), (NOW - 3600 * 5 + 60, 0)):
        door, hatch, new = posed_at(ctx, models, time)
        assert door.probability == predict(fitted(ctx, "door").spectrum, time)[0]
        assert np.isnan([hatch.probability, new.probability]).all()
        assert (door.observed, hatch.observed, new.observed) == (seen, seen, UNOBSERVED)
        assert door.observed_time == models[0].location.base.time(models[0].location.base.sample(min(time, NOW - 60)))
    assert posed_at(ctx, models, NOW - 90000)[0].observed == UNOBSERVED


def test_what_is_deleted_while_it_is_asked_for_is_left_out(ctx: Context) -> None:
    for name in ("door", "hatch"):
        make_door(ctx, name)
    models = posed_models(ctx, "building")
    posed_at(ctx, models, NOW)
    ahead = [Fitted(replace(each.location, observation_seq=99), each.loaded) for each in models]
    delete_location(ctx, "door")
    assert [state.location.name for state in posed_at(ctx, ahead, NOW)] == ["hatch"]
