"""The repository of rhythms: when locations were heard, and since when a server listens."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection, insert, select, update

from tidemap.storage.records import LocationRecord, RhythmRecord
from tidemap.storage.tables import anomaly, listening, observation, rhythm


class RhythmRepository:
    """When locations were heard."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def all(self) -> dict[int, RhythmRecord]:
        """By id of location."""
        rows = self._connection.execute(select(rhythm)).mappings()
        return {row["location_id"]: RhythmRecord(**row) for row in rows}

    def find(self, location_id: int) -> RhythmRecord | None:
        """That of one location; None where nothing was heard of it yet."""
        row = self._connection.execute(select(rhythm).where(rhythm.c.location_id == location_id)).mappings().first()
        return None if row is None else RhythmRecord(**row)

    def silent(self, location_ids: Collection[int]) -> Mapping[int, float]:
        """Since when those of some locations are silent that are."""
        event = (anomaly.c.location_id == rhythm.c.location_id) & (anomaly.c.id == rhythm.c.silence)
        query = select(rhythm.c.location_id, anomaly.c.start).join(anomaly, event)
        rows = self._connection.execute(query.where(rhythm.c.location_id.in_(location_ids)))
        return {row.location_id: row.start for row in rows}

    def put(self, record: RhythmRecord) -> None:
        """Store what is known of a location now."""
        values = asdict(record)
        mine = rhythm.c.location_id == record.location_id
        if not self._connection.execute(update(rhythm).where(mine).values(**values)).rowcount:
            self._connection.execute(insert(rhythm).values(**values))

    def received(self, location: LocationRecord, after: int) -> Iterator[float]:
        """When the observations after a number came, in order; to be read to the end before the next statement."""
        query = (
            select(observation.c.received_at)
            .where(observation.c.location_id == location.id, observation.c.id > after)
            .where(observation.c.id <= location.observation_seq)
            .order_by(observation.c.id)
        )
        with self._connection.execute(query, execution_options={"yield_per": 4096}) as rows:
            yield from rows.scalars()

    def listening(self) -> tuple[float, float] | None:
        """Since when a server has listened without a break, and until when that is known."""
        row = self._connection.execute(select(listening.c.since, listening.c.until)).first()
        return None if row is None else (row.since, row.until)

    def listen(self, since: float, until: float) -> None:
        """Store that."""
        values: dict[str, Any] = {"since": since, "until": until}
        if not self._connection.execute(update(listening).values(**values)).rowcount:
            self._connection.execute(insert(listening).values(id=1, **values))
