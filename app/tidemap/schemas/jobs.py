"""Jobs on the wire."""

from typing import Any, Literal

from pydantic import Field

from tidemap.schemas.common import Answer, Form, TimeIn, TimeOut, shown
from tidemap.schemas.locations import EstimatorChoice, OrderChoice

JobState = Literal["queued", "running", "done", "failed", "cancelled"]


class UpdateForm(Form):
    """Refit a location; what is left out is the location's own setting, and the window chosen by the service."""

    model_config = shown({"estimator": "fft", "order": 15}, {})

    start: TimeIn | None = None
    stop: TimeIn | None = None
    estimator: EstimatorChoice | None = None
    order: OrderChoice | None = None


class Job(Answer):
    """Long work and how far it is."""

    id: int
    kind: str
    location: str
    state: JobState
    progress: float = Field(ge=0, le=1)
    error: str | None = None
    waiting: str | None = Field(None, description="What keeps it from going on, such as a cluster without workers.")
    result: dict[str, Any] | None = None
    created_at: TimeOut
    finished_at: TimeOut | None = None
