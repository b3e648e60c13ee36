"""Posting measurements."""

import uuid

from app.client.encoding import ARROW, Measurements, arrow, batches
from app.client.plans import Plan, Request
from app.client.requests import given
from app.schemas.observations import Accepted


def posts(path: str, columns: Measurements, source: str | None, key: str | None) -> Plan[Accepted]:
    """Post the measurements in batches to the location at `path`.

    Every batch has its idempotency key before it is first sent: `key`, or a new one.
    """
    key = key or uuid.uuid4().hex
    parts = list(batches(columns))
    stored = []
    for i, part in enumerate(parts):
        headers = {"Content-Type": ARROW, "Idempotency-Key": f"{key}-{i}" if len(parts) > 1 else key}
        response = yield Request("POST", f"{path}/observations", given(source=source), arrow(part), headers)
        stored.append(Accepted.model_validate_json(response.content))
    return merged(stored)


def merged(stored: list[Accepted]) -> Accepted:
    """The answers to consecutive batches as one; an anomaly that several report is told as last reported."""
    events = [event for answer in stored for event in answer.anomalies]
    firsts = [answer.first_time for answer in stored if answer.first_time is not None]
    lasts = [answer.last_time for answer in stored if answer.last_time is not None]
    return Accepted(
        accepted=sum(answer.accepted for answer in stored),
        duplicate=all(answer.duplicate for answer in stored),
        first_time=min(firsts, default=None),
        last_time=max(lasts, default=None),
        anomalies=list({event.id if event.id is not None else -i: event for i, event in enumerate(events)}.values()),
        revision=stored[-1].revision,
    )
