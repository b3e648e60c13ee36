"""Boosting: gradient boosting fitted for each horizon on readings and civil time, a rival that learns anything."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier

from tidemap.history.history import History
from tidemap.history.timebase import TimeBase
from tidemap.spectral.civil import DAY_S, civil_seconds
from tidemap.spectral.evaluation import ScoreSums, score
from tidemap.spectral.horizons import Ahead, WalkPlan, ahead
from tidemap.spectral.pairs import CellReadings

MAX_ROWS = 20_000
"""Pairs that are learned from, evenly spread over the past."""
MAX_TREES = 200


@dataclass(frozen=True, slots=True, eq=False)
class Clocks:
    """Where and when a signal was recorded."""

    base: TimeBase
    time_zone: str


def boosted(history: History, clocks: Clocks, plan: WalkPlan) -> list[ScoreSums]:
    """Scores by horizon of the only cell, over the same readings as `walk` and refitted as often."""
    return [_at_horizon(history, clocks, plan, horizon) for horizon in plan.horizons]


def _at_horizon(history: History, clocks: Clocks, plan: WalkPlan, horizon: int) -> ScoreSums:
    sums = ScoreSums()
    for cut in range(plan.start, history.stop, plan.step):
        readings = CellReadings.of(history.window(history.start, min(cut + plan.step, history.stop)), 0)
        past = _thinned(ahead(CellReadings.of(history.window(history.start, cut), 0), history.start, horizon))
        later = ahead(readings, cut, horizon)
        if later.later.size:
            sums.add(_expected(readings, clocks, past, later), readings.state[later.later])
    return sums


def _thinned(pairs: Ahead) -> Ahead:
    step = max(1, pairs.later.size // MAX_ROWS)
    return Ahead(pairs.later[::step], pairs.earlier[::step])


def _expected(readings: CellReadings, clocks: Clocks, past: Ahead, later: Ahead) -> NDArray[np.float64]:
    """What is expected of the later readings, learned from pairs of the past; rows of both are those of `readings`.

    The number of trees is the best on every fifth day of the past when learned from the others.
    """
    truth, features = readings.state[past.later], _features(readings, clocks, past)
    tried = clocks.base.time(readings.sample[past.later]) // DAY_S % 5 == 4
    rest = ~tried
    if not tried.any() or not rest.any() or truth[rest].min() == truth[rest].max():
        return np.full(later.later.size, (truth.sum() + 0.5) / (truth.size + 1))
    losses = [
        score(p[:, 1], truth[tried]).log_loss
        for p in _model(MAX_TREES).fit(features[rest], truth[rest]).staged_predict_proba(features[tried])
    ]
    model = _model(1 + int(np.argmin(losses))).fit(features, truth)
    return np.asarray(model.predict_proba(_features(readings, clocks, later))[:, 1], np.float64)


def _model(n_trees: int) -> HistGradientBoostingClassifier:
    return HistGradientBoostingClassifier(
        learning_rate=0.05,
        max_iter=n_trees,
        max_leaf_nodes=8,
        min_samples_leaf=50,
        early_stopping=False,
        random_state=0,
    )


def _features(readings: CellReadings, clocks: Clocks, pairs: Ahead) -> NDArray[np.float64]:
    """The state read, how long ago, since when, the civil time of day of then and now, and whether it is a weekend now;
    (n, 6)."""
    read, asked = readings.sample[pairs.earlier], readings.sample[pairs.later]
    then, now = (civil_seconds(clocks.base.middle(each), clocks.time_zone) for each in (read, asked))
    age = read - readings.begin[pairs.earlier] + 1
    columns = (readings.state[pairs.earlier], np.log(asked - read), np.log(age))
    civil = (now % DAY_S, then % DAY_S, now // DAY_S % 7 >= 5)
    return np.stack([np.asarray(each, np.float64) for each in (*columns, *civil)], axis=1)
