"""Acknowledging: somebody has seen an event."""

from tidemap.services.anomalies import Anomaly, anomaly_of
from tidemap.services.context import Context
from tidemap.services.incidents import EventChange
from tidemap.services.messages import publish_said
from tidemap.storage.work import Work


def acknowledge(ctx: Context, anomaly_id: int, by: str, note: str | None) -> Anomaly:
    """Say that somebody has seen an event, now; again, it replaces who, when and the note. Raises AnomalyNotFoundError.

    Who listens hears of it as of every change of the event.
    """

    def run(work: Work) -> EventChange:
        record = work.anomalies.acknowledge(anomaly_id, by, ctx.clock(), note)
        return EventChange(anomaly_of(work.locations.by_id(record.location_id), record), "updated")

    return ctx.store.write(run, lambda change: publish_said(ctx, change, "acknowledged")).event
