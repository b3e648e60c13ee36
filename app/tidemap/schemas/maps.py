"""Questions about a map and their answers. Large answers are encoded from arrays; these forms document them."""

from typing import Annotated, Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Many, TimeIn, TimeOut, shown
from tidemap.schemas.locations import Confidence, EstimatorName, Grid

Given = Literal["observations", "model"]
ExportFormat = Literal["nav2", "octomap", "ply", "pcd", "npz", "arrow"]
ExportSource = Literal["predicted", "observed"]
ExportMode = Literal["trinary", "scale"]
Verdict = Literal["occupied", "free", "uncertain"]
Index = Annotated[list[int], Field(min_length=2, max_length=3)]
UNAVAILABLE = (
    "Cells [first, stop) whose stored state is damaged, as the server's log says: they are missing here. "
    "Empty when all is well."
)


class StateAnswer(Answer):
    """The state at a time, for the cells that have been observed."""

    time: TimeOut
    as_of: TimeOut = Field(description="The readings at or before this moment were used.")
    given: Given
    confidence: float
    estimator: str
    order: int
    revision: int
    shape: list[int]
    grid: Grid | None = Field(None, description="Where the cells are; null of kind `state`.")
    cell: list[int]
    probability: list[float]
    state: list[int]
    verdict: list[Verdict]
    observed: list[int | None] | None = Field(None, description="As last seen at that time (`observed=true`).")
    observed_time: list[float | None] | None = None
    last_seen: list[float | None] | None = Field(
        None, description="When each cell was read last, at or before `as_of` (`last_seen=true`); start of the sample."
    )
    unavailable: list[tuple[int, int]] = Field(description=UNAVAILABLE)


class PredictForm(Form):
    """Ask for many times (and some cells) at once."""

    model_config = shown({"time": ["2026-03-02T09:00:00Z", 1772442000], "cell": [0], "confidence": 0.9})

    time: Many[TimeIn] = Field(min_length=1)
    cell: Many[int | Index] | None = Field(None, description="Each its linear index or [i,j,k]; by default all.")
    confidence: Confidence | None = None
    order: int | None = Field(None, ge=0, le=64)
    estimator: EstimatorName | None = None
    as_of: TimeIn | None = Field(None, description="Use the readings at or before this moment; by default now.")
    given: Given = "observations"


class PredictionAnswer(Answer):
    """Per cell, per time. Null where a cell has never been observed."""

    time: list[float]
    cell: list[int]
    confidence: float
    probability: list[list[float | None]]
    state: list[list[int | None]]
    entropy: list[list[float | None]]
    as_of: TimeOut
    given: Given
    revision: int
    unavailable: list[tuple[int, int]] = Field(description=UNAVAILABLE)


class SeriesAnswer(Answer):
    """One cell over time: at every time what holds for the sample that contains it; null where it was not observed.

    Of a `step` longer than a sample, `observed` is the latest measurement in the step, where there is one.
    """

    cell: int
    time: list[float]
    probability: list[float | None]
    state: list[int | None]
    observed: list[int | None]
    revision: int


class DensityAnswer(Answer):
    """How much was observed in each step [time, time + step_s) of a stretch of time, of whole samples."""

    time: list[float]
    step_s: float
    step_samples: int = Field(description="Samples in a step.")
    measurements: list[int] = Field(
        description="Of all cells, one a sample where history has them by now, as they came where it has not."
    )
    samples: list[int] = Field(description="Samples in which any cell was observed.")
    cells: int = Field(description="How many cells were counted: of a very large map some stand for all.")


class BestTime(Answer):
    """A time at which looking is worth most; `information` in nats, summed over the region."""

    time: float
    information: float


class InformationAnswer(Answer):
    """What looking is expected to say of the states of a region, in nats: at most ln 2 of a cell, 0 of a certain one.

    `entropy` is what is not known, per time; `information` what a look tells of it: the same, less the noise of looks
    that err. Both are sums over the `cells` that have been observed. Of a question for one time, `cell`,
    `cell_entropy` and `cell_information` are those of every cell. `best`: the best times first, any two at least
    `apart_s` seconds apart.
    """

    time: list[float]
    entropy: list[float]
    information: list[float]
    cells: int
    cell: list[int] | None = None
    cell_entropy: list[float] | None = None
    cell_information: list[float] | None = None
    best: list[BestTime]
    apart_s: float
    as_of: TimeOut
    given: Given
    revision: int
    unavailable: list[tuple[int, int]] = Field(description=UNAVAILABLE)


class Component(Answer):
    """One wave: amplitude·cos(2π·frequency_hz·τ + phase); with `gate` weekend on Saturdays and Sundays only.

    τ is the same all over the sample that contains t. Where the model's `time_zone` is null (fft) it is the time from
    `start` to the start of that sample, else the civil time of its middle since a Monday 00:00 (calendar), in seconds.
    `period_s` is null for a constant, which a gate may have.
    """

    amplitude: float
    phase: float
    frequency_hz: float
    period_s: float | None
    gate: str | None = None


class Compression(Answer):
    """What the history and the spectrum of this cell cost, against one bit a sample.

    `lossy_ratio` = raw bytes / spectrum bytes; `lossless_ratio` = raw bytes / history bytes (what is stored);
    `paper_lossless_ratio` = raw bytes / (spectrum + outlier bytes), the form of the paper.
    """

    samples: int
    raw_bytes: int
    history_bytes: int
    spectrum_bytes: int
    outlier_bytes: int
    lossy_ratio: float
    lossless_ratio: float
    paper_lossless_ratio: float


class SelectionRow(Answer):
    """One candidate that `auto` tried, with its forward-chaining scores."""

    estimator: str
    order: int
    error: float | None
    brier: float | None
    log_loss: float | None
    n: int


class Selection(Answer):
    """What `auto` chose and why."""

    estimator: str
    order: int
    reason: str
    cells: int
    scores: list[SelectionRow]


class LearnedSensor(Answer):
    """How often the sensor errs, as the update learned it from `readings`, or 0 where it did not; `reason` says why."""

    miss: float
    false_alarm: float
    readings: int
    reason: str


class Model(Answer):
    """The spectrum P and the outliers O of one cell. Times of outliers are Unix seconds, [start, stop).

    p(t) = link⁻¹(mean + Σ components), clipped to [0, 1].
    """

    cell: int
    estimator: str
    link: Literal["identity", "logit"]
    time_zone: str | None
    order: int
    start: TimeOut
    stop: TimeOut
    samples: int
    interval_s: float
    mean: float | None
    components: list[Component]
    outliers: list[tuple[float, float]]
    accuracy: float | None
    compression: Compression
    selection: Selection | None
    sensor: LearnedSensor | None = None
    revision: int


class EvaluateForm(Form):
    """Score orders and estimators against the history in [start, stop), or against measurements given.

    Each candidate is fitted on the window of the current revision, or on [train_start, train_stop).

    With `horizons_s` the answer given what was read is scored too (or only, without `orders`): every reading in
    [start, stop), by default the last quarter of the history, is predicted from the latest reading at least so many
    seconds before it. What predicts it is learned as in an update, daily or, of more than eight days, eight times, each
    time from what was read since `train_start` and before. Where the sensor errs it is its readings that are predicted,
    errors included. At most 16 horizons, each up to 366 days.
    """

    model_config = shown(
        {"start": "2026-02-23T00:00:00Z", "stop": "2026-03-02T00:00:00Z", "orders": [0, 1, 2, 3, 5, 10, 15]},
        {"time": [1772442000, "2026-03-02T21:00:00Z"], "state": [1, 0], "orders": [2], "estimators": ["fft"]},
        {"horizons_s": [60, 300, 900, 3600, 86400], "start": "2026-02-23T00:00:00Z"},
    )

    start: TimeIn | None = None
    stop: TimeIn | None = None
    orders: Many[int] = Field([], max_length=65, description="Required without `horizons_s`.")
    horizons_s: Many[float] = Field([], max_length=16)
    estimators: Many[EstimatorName] | None = Field(None, min_length=1)
    confidence: Confidence | None = None
    time: Many[TimeIn] | None = None
    state: Many[Literal[0, 1]] | None = None
    train_start: TimeIn | None = None
    train_stop: TimeIn | None = None


class EvaluationRow(Answer):
    """Scores of one candidate; accuracy is 1 - error."""

    estimator: str
    order: int
    error: float
    brier: float
    log_loss: float
    n: int


class Best(Answer):
    """The candidate with the least log loss."""

    estimator: str
    order: int


class ReliabilityRow(Answer):
    """Of the predictions in one bin of probability: their mean, and how often the cell was occupied."""

    probability: float
    observed: float
    n: int


class ModelScores(Answer):
    """How one kind of answer did at a horizon; null where nothing was scored.

    calibration_error: the mean of |predicted - observed| over the bins of `reliability`, weighted by their counts.
    """

    error: float | None
    brier: float | None
    log_loss: float | None
    calibration_error: float | None
    n: int
    reliability: list[ReliabilityRow]


class HorizonRow(Answer):
    """Scores of the same readings, each predicted from the latest at least `samples` samples before it.

    conditioned: the answer given that reading; rhythm: the model's p(t) alone; persistence: that reading, left at a
    learned rate, without a rhythm.
    """

    horizon_s: float
    samples: int
    conditioned: ModelScores
    rhythm: ModelScores
    persistence: ModelScores


class Evaluation(Answer):
    """All scores, the best, and the reliability table of the best; none without `orders`. By horizon, where asked."""

    results: list[EvaluationRow]
    best: Best | None
    reliability: list[ReliabilityRow]
    horizons: list[HorizonRow]
    revision: int
