"""Anomaly events on the wire."""

from typing import Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, Text, TimeIn, TimeOut, shown
from tidemap.schemas.locations import Confidence, EstimatorName

Rule = Literal["surprise", "paper"]
EventRule = Literal["surprise", "paper", "silence"]


class EventParts(Answer):
    """The cells of an event by what they were seen as: unexpectedly occupied, or unexpectedly free."""

    occupied: list[int]
    free: list[int]


class Event(Answer):
    """One incident: neighbouring surprising cells, and those of later and earlier observations that continue them.

    It grows while it lasts, under the same id: `start` and `stop` are the bounds of the surprising samples. `observed`
    is how most of its cells were seen, `parts` says which were what where they differ, and is null where they do not.
    `bbox` is [x0,y0,z0,x1,y1,z1] in metres in the grid's frame (null for kind `state`); `probability` is the
    mean predicted probability of the cells, `surprise` the peak of |p - s|. `id` is null for events that were
    computed on request and are not stored. Lists and messages have the first 10,000 cells of an event, of
    `cells_total`; GET /anomalies/{id} has all of them.

    An event of rule `silence` is no surprise: a location that usually speaks does not. It has no cells, `observed` is
    null, `probability` and `surprise` are how likely it was that it would have spoken since `start`. `ended`: what is
    measured from now on does not continue it. `muted`: nobody hears of it, as all of it lies in a time that was muted;
    nor until `snoozed_until`. `change` is the number of its latest change: a stream resumes behind it.
    """

    id: int | None
    location: str
    start: TimeOut
    stop: TimeOut
    cells: list[int]
    cells_total: int = Field(default_factory=lambda event: len(event["cells"]))
    bbox: list[float] | None
    observed: Literal[0, 1] | None
    parts: EventParts | None = None
    probability: float
    surprise: float
    confidence: float
    rule: EventRule
    revision: int
    acknowledged_by: str | None = None
    acknowledged_at: TimeOut | None = None
    note: str | None = None
    ended: bool = False
    muted: bool = False
    snoozed_by: str | None = None
    snoozed_until: TimeOut | None = None
    change: int | None = None


class EventReasons(Answer):
    """Why an event is one, of the `cell` that was most surprising when it began, by the model as it is now.

    `expected` is the probability that it is occupied then. `usual` is the share of `samples` in which it was occupied
    at that hour of that weekday, in the eight weeks before; null without any. `last_like_this` is the latest time
    before, at that hour of that weekday in half a year, when it was as it was in the event; null where it never was.
    """

    cell: int
    observed: Literal[0, 1]
    expected: float | None
    usual: float | None
    samples: int
    last_like_this: TimeOut | None


class EventDetail(Event):
    """An event with its reasons; they are null where its cells cannot be read."""

    reasons: EventReasons | None = None


class ConfidenceRate(Answer):
    """What a confidence gives on the history: `events`, the mean of a week, and bounds of it that hold with 90 %.

    They are null where there are too many to count.
    """

    confidence: float
    events: int | None
    per_week: float | None
    low: float | None
    high: float | None


class ConfidenceAnswer(Answer):
    """The least confidence tried that gives no more than the wanted events a week on `weeks` of history.

    `reached` is false where none does; then it is the one that gives the fewest. All of the history in [start, stop)
    is taken to have been in order, and the model was fitted to it: what comes later is a little more surprising.
    """

    rule: Rule
    confidence: float
    reached: bool
    start: TimeOut
    stop: TimeOut
    weeks: float
    revision: int
    rates: list[ConfidenceRate]


class DetectForm(Form):
    """Which part of the history to search for anomalies."""

    model_config = shown(
        {"start": "2026-02-23T00:00:00Z", "stop": "2026-03-02T00:00:00Z", "confidence": 0.95, "rule": "surprise"}
    )

    start: TimeIn
    stop: TimeIn
    confidence: Confidence | None = Field(None, description="Default: the location's.")
    rule: Rule = "surprise"
    order: int | None = Field(None, ge=0, le=64)
    estimator: EstimatorName | None = None


class AcknowledgeForm(Form):
    """An operator has seen an event."""

    model_config = shown({"note": "The cleaners came early."})

    note: Text | None = Field(None, max_length=2000)


class SnoozeForm(Form):
    """Nobody is to hear of an event until a time; null: from now on they are again."""

    model_config = shown({"until": "2026-03-02T08:00:00Z"})

    until: TimeIn | None


class Events(Answer):
    """Events computed over the history."""

    items: list[Event]
    next: None = None
    revision: int
