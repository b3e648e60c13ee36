"""Messages of /events as they go over the wire."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from tidemap.schemas.common import TimeOut


class WireMessage(BaseModel):
    """Something happened at a location. Further fields are those of the kind: of an anomaly, those of an `Event`."""

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "examples": [
                {
                    "kind": "observation",
                    "location": "office-door",
                    "id": 512,
                    "time": "2026-03-02T02:10:07Z",
                    "measurements": 1,
                }
            ]
        },
    )

    kind: Literal["observation", "anomaly", "update", "job", "location", "attention"]
    location: str
    id: int = Field(description="Of the observation, anomaly, revision, job, location or mute.")
    time: TimeOut = Field(description="When it was published.")
