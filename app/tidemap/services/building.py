"""Building: the doors and rooms that stand in a frame, and the state of each at a time."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from tidemap.errors import CorruptChunkError, LocationNotFoundError
from tidemap.history.history import UNOBSERVED
from tidemap.scope import EVERYWHERE, Scope
from tidemap.services.context import Context
from tidemap.services.films import small_film
from tidemap.services.map_view import unmodelled
from tidemap.services.spectra import Fitted, held_fit, stored
from tidemap.spectral.prediction import predict
from tidemap.storage.records import LocationRecord

MAX_POSED: Final = 200
"""States of a frame that are asked for, the first by name."""
CELLS: Final = np.zeros(1, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class PosedState:
    """A state that stands in a frame, at a time.

    probability: by the model, NaN without one. observed: as it was last seen by then, in the sample that began at
    `observed_time` (Unix seconds); UNOBSERVED and None where it never was.
    """

    location: LocationRecord
    probability: float
    observed: int
    observed_time: float | None


def posed_models(ctx: Context, frame: str, scope: Scope = EVERYWHERE) -> list[Fitted]:
    """The states in scope that stand in a frame with a position, and what is known of each, of revision 0 before it has
    a model, or where that is damaged."""
    with ctx.store.read() as work:
        records = [each for each in work.locations.posed(scope) if each.pose is not None and each.pose.frame == frame]
        records = records[:MAX_POSED]
        missing = [each.id for each in records if each.revision and held_fit(ctx, each) is None]
        revisions = work.spectra.current(missing) if missing else {}
    models = []
    for record in records:
        loaded = held_fit(ctx, record)
        try:
            revision = revisions.get(record.id)
            if loaded is None and revision is not None:
                loaded = stored(ctx, record, revision).loaded
        except CorruptChunkError:
            loaded = None
        models.append(Fitted(record, unmodelled(record, CELLS) if loaded is None else loaded))
    return models


def posed_at(ctx: Context, models: Sequence[Fitted], time: float) -> list[PosedState]:
    """Their states at a time (Unix seconds), without those that have been deleted meanwhile."""
    states = []
    for model in models:
        with suppress(LocationNotFoundError):
            states.append(_posed_at(ctx, model, time))
    return states


def _posed_at(ctx: Context, model: Fitted, time: float) -> PosedState:
    probability = float(predict(model.spectrum, time, CELLS)[0]) if model.revision.revision else np.nan
    seen = small_film(ctx, model, time)
    observed = int(seen.state[0])
    at = None if observed == UNOBSERVED else float(model.location.base.time(seen.sample[0]))
    return PosedState(model.location, probability, observed, at)
