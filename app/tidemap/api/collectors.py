"""Metrics that are read when they are asked for: of the database, and of what is known to be damaged."""

from collections.abc import Iterable, Iterator

from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from tidemap.errors import StorageUnavailableError
from tidemap.services.context import Context
from tidemap.services.monitoring import monitored

Families = Iterator[GaugeMetricFamily]


class ContextCollector(Collector):
    """Gauges of a context; those of the database are left out while it does not answer."""

    def __init__(self, ctx: Context) -> None:
        self._ctx = ctx

    def collect(self) -> Families:
        """All gauges."""
        yield GaugeMetricFamily("tidemap_commit_queue", "Writes that wait for the writer.", self._ctx.store.waiting())
        yield GaugeMetricFamily("tidemap_damaged_blobs", "Stored blobs found corrupt.", self._ctx.damage.count())
        yield from self._stored()

    def _stored(self) -> Families:
        try:
            found = monitored(self._ctx)
        except StorageUnavailableError:
            return
        waiting = "Measurements in the log that are not compacted yet."
        yield GaugeMetricFamily("tidemap_compaction_backlog_measurements", waiting, found.waiting)
        yield GaugeMetricFamily("tidemap_database_bytes", "Bytes of the database on its disk.", found.database_bytes)
        yield GaugeMetricFamily("tidemap_locations", "Locations.", found.locations)
        yield _times("observation", "Time of the latest measurement", ((at.name, at.observed) for at in found.latest))
        yield _times("update", "Time of the latest update", ((at.name, at.updated) for at in found.latest))


def _times(what: str, help_text: str, times: Iterable[tuple[str, float | None]]) -> GaugeMetricFamily:
    """Unix seconds by location; one that has none is left out."""
    family = GaugeMetricFamily(
        f"tidemap_location_last_{what}_timestamp_seconds", f"{help_text} of a location.", labels=["location"]
    )
    for name, time in times:
        if time is not None:
            family.add_metric([name], time)
    return family
