"""Observations on the wire. Large bodies are parsed columnar by `tidemap.ingest`; these forms document them."""

from typing import Annotated, Literal

from pydantic import Field

from tidemap.schemas.anomalies import Event
from tidemap.schemas.common import Answer, Form, TimeIn, TimeOut

Layout = Literal["ros"]
Cell = Annotated[int, Field(ge=0)]
Cells = list[Cell | Annotated[list[Cell], Field(min_length=2, max_length=3)]]


class StateObservations(Form):
    """Measurements of a location of kind `state`: two columns of one length."""

    time: list[TimeIn] = Field(min_length=1)
    state: list[Literal[0, 1] | None] = Field(
        min_length=1,
        description="1 occupied, 0 free, null where the sensor is unavailable: from then on nothing is held.",
    )


class GridObservation(Form):
    """What was seen of a grid at one time; a cell in neither list was not seen. It is its linear index or [i,j,k]."""

    time: TimeIn
    occupied: Cells = Field(default=[], description="Cells seen occupied.")
    free: Cells = Field(default=[], description="Cells seen free.")
    unavailable: Cells = Field(default=[], description="Cells whose state the sensor does not know from now on.")


class GridObservations(Form):
    """Observations of a grid."""

    observations: list[GridObservation] = Field(min_length=1)


class Accepted(Answer):
    """The answer to a post, sent after the durable commit."""

    accepted: Annotated[int, Field(description="Measurements stored.")]
    dropped: Annotated[int, Field(description="Measurements older than the location's `retention`: not stored.")] = 0
    duplicate: bool
    first_time: TimeOut | None
    last_time: TimeOut | None
    anomalies: list[Event] = Field(
        description="The 100 most surprising, in order of their start; all are stored, and listed by GET /anomalies."
    )
    anomalies_total: Annotated[int, Field(description="How many there are.")] = 0
    revision: int


class Deleted(Answer):
    """The answer to a deletion, sent after the durable commit."""

    deleted: Annotated[int, Field(description="Measurements deleted; of a compacted sample one a cell.")]
