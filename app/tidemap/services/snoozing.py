"""Snoozing: nobody hears of an event until a time; then those who listen do."""

from dataclasses import replace

from tidemap.errors import InvalidInputError
from tidemap.services.anomalies import Anomaly
from tidemap.services.context import Context
from tidemap.services.ending import marked
from tidemap.services.incidents import EventChange
from tidemap.services.messages import publish_events, publish_said
from tidemap.storage.work import Work


def snooze(ctx: Context, anomaly_id: int, by: str, until: float | None) -> Anomaly:
    """Nobody hears of an event until a time (Unix s); None: from now on they do again.

    Raises AnomalyNotFoundError, InvalidInputError where the time has passed.
    """
    if until is not None and until <= ctx.clock():
        raise InvalidInputError.at("until", "this time has passed; give a later one, or null to hear of it again")

    def run(work: Work) -> EventChange:
        event = work.anomalies.locked(anomaly_id)
        return marked(work, [replace(event, snoozed_by=None if until is None else by, snoozed_until=until)])[0]

    return ctx.store.write(run, lambda change: publish_said(ctx, change, "snoozed")).event


def end_snoozes(ctx: Context) -> None:
    """Publish the events whose snooze is over."""
    with ctx.store.read() as work:
        if not work.anomalies.awake(ctx.clock()):
            return

    def wake(work: Work) -> list[EventChange]:
        events = work.anomalies.awake(ctx.clock())
        return marked(work, [replace(event, snoozed_by=None, snoozed_until=None) for event in events])

    ctx.store.write(wake, lambda changes: publish_events(ctx, changes))
