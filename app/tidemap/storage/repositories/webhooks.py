"""The repository of webhooks and their deliveries."""

import builtins
from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from tidemap.errors import DeliveryNotFoundError, WebhookNotFoundError
from tidemap.scope import Scope
from tidemap.storage.counters import take
from tidemap.storage.records import DeliveryRecord, WebhookRecord
from tidemap.storage.tables import delivery, webhook

KNOWN_AT_ONCE = 500
"""Ids in one question."""


class WebhookRepository:
    """Webhooks in order of creation, and their deliveries in the order of the changes."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def create(self, values: dict[str, Any]) -> WebhookRecord:
        """Store a new one."""
        # A number is never given again: deliveries and receivers go by it.
        number = take(self._connection, "webhook")
        self._connection.execute(insert(webhook).values(id=number, **values))
        return self.get(number)

    def get(self, webhook_id: int) -> WebhookRecord:
        """Raises WebhookNotFoundError."""
        found = self.find(webhook_id)
        if found is None:
            raise WebhookNotFoundError(webhook_id)
        return found

    def find(self, webhook_id: int) -> WebhookRecord | None:
        """As it is now; None where it is gone."""
        row = self._connection.execute(select(webhook).where(webhook.c.id == webhook_id)).mappings().first()
        return None if row is None else _record(row)

    def list(self, after: int | None = None, limit: int | None = None) -> list[WebhookRecord]:
        """In order of creation; `after` is the last id of the page before."""
        query = select(webhook).order_by(webhook.c.id).limit(limit)
        if after is not None:
            query = query.where(webhook.c.id > after)
        return [_record(row) for row in self._connection.execute(query).mappings()]

    def count(self) -> int:
        """How many there are."""
        return int(self._connection.execute(select(func.count()).select_from(webhook)).scalar_one())

    def change(self, webhook_id: int, values: dict[str, Any]) -> WebhookRecord:
        """Raises WebhookNotFoundError."""
        if values:
            self._connection.execute(update(webhook).where(webhook.c.id == webhook_id).values(**values))
        return self.get(webhook_id)

    def disable(self, webhook_id: int, url: str) -> None:
        """Send nothing more to this URL; a webhook that is gone, or that goes elsewhere by now, stays as it is."""
        there = (webhook.c.id == webhook_id) & (webhook.c.url == url)
        self._connection.execute(update(webhook).where(there).values(enabled=False))

    def delete(self, webhook_id: int) -> None:
        """With its deliveries. Raises WebhookNotFoundError."""
        self.get(webhook_id)
        self._connection.execute(delete(delivery).where(delivery.c.webhook_id == webhook_id))
        self._connection.execute(delete(webhook).where(webhook.c.id == webhook_id))

    def add_deliveries(self, webhook_id: int, messages: dict[int, tuple[str, bool]], cursor: int, now: float) -> None:
        """Deliveries, due now: by the anomaly's id that of the message, and whether it is an update.

        `cursor` is the last change that was looked at.
        """
        if messages:
            first = take(self._connection, "delivery", len(messages))
            new = {"webhook_id": webhook_id, "state": "waiting", "attempts": 0, "next_at": now, "created_at": now}
            rows = [
                {**new, "id": first + i, "anomaly_id": anomaly_id, "message_id": message_id, "update": is_update}
                for i, (anomaly_id, (message_id, is_update)) in enumerate(messages.items())
            ]
            self._connection.execute(insert(delivery), rows)
        self._connection.execute(update(webhook).where(webhook.c.id == webhook_id).values(cursor=cursor))

    def waiting(self, webhook_id: int) -> int:
        """How many deliveries wait."""
        mine = (delivery.c.webhook_id == webhook_id) & (delivery.c.state == "waiting")
        return int(self._connection.execute(select(func.count()).select_from(delivery).where(mine)).scalar_one())

    def untried(self, webhook_id: int) -> builtins.set[int]:
        """The anomalies whose latest delivery waits and was not tried yet."""
        mine = (delivery.c.webhook_id == webhook_id) & (delivery.c.state == "waiting") & (delivery.c.attempts == 0)
        return set(self._connection.execute(select(delivery.c.anomaly_id).where(mine)).scalars())

    def known(self, webhook_id: int, anomalies: Sequence[int]) -> builtins.set[int]:
        """Those of some anomalies that the webhook has had, or is to have."""
        found: builtins.set[int] = set()
        for first in range(0, len(anomalies), KNOWN_AT_ONCE):
            some = delivery.c.anomaly_id.in_(anomalies[first : first + KNOWN_AT_ONCE])
            query = select(delivery.c.anomaly_id).where(delivery.c.webhook_id == webhook_id, some)
            found |= set(self._connection.execute(query).scalars())
        return found

    def due(self, webhook_id: int, now: float, limit: int) -> builtins.list[DeliveryRecord]:
        """Deliveries to try now, those of older changes first; of an anomaly none before an earlier one has its end."""
        mine = (delivery.c.webhook_id == webhook_id) & (delivery.c.state == "waiting") & (delivery.c.next_at <= now)
        before = delivery.alias()
        earlier = (
            select(before.c.id)
            .where(before.c.webhook_id == webhook_id, before.c.anomaly_id == delivery.c.anomaly_id)
            .where(before.c.state == "waiting", before.c.id < delivery.c.id)
        )
        query = select(delivery).where(mine, ~earlier.exists()).order_by(delivery.c.id).limit(limit)
        return self._deliveries(query)

    def get_delivery(self, webhook_id: int, delivery_id: int) -> DeliveryRecord:
        """Raises DeliveryNotFoundError."""
        mine = (delivery.c.webhook_id == webhook_id) & (delivery.c.id == delivery_id)
        found = self._deliveries(select(delivery).where(mine))
        if not found:
            raise DeliveryNotFoundError(delivery_id)
        return found[0]

    def deliveries(
        self, webhook_id: int, state: str | None, before: int | None, limit: int
    ) -> builtins.list[DeliveryRecord]:
        """Newest first; `before` is the last id of the page before. Raises WebhookNotFoundError."""
        self.get(webhook_id)
        query = select(delivery).where(delivery.c.webhook_id == webhook_id).order_by(delivery.c.id.desc()).limit(limit)
        if state is not None:
            query = query.where(delivery.c.state == state)
        if before is not None:
            query = query.where(delivery.c.id < before)
        return self._deliveries(query)

    def change_delivery(self, delivery_id: int, **values: Any) -> None:
        """What has become of a delivery; of one that is gone, nothing."""
        self._connection.execute(update(delivery).where(delivery.c.id == delivery_id).values(**values))

    def drop_delivery(self, delivery_id: int) -> None:
        """There is nothing to deliver any more."""
        self._connection.execute(delete(delivery).where(delivery.c.id == delivery_id))

    def prune(self, webhook_id: int, state: str, kept: int) -> None:
        """Drop the oldest deliveries of a state."""
        mine = (delivery.c.webhook_id == webhook_id) & (delivery.c.state == state)
        newest = select(delivery.c.id).where(mine).order_by(delivery.c.id.desc()).offset(kept).limit(1)
        last = self._connection.execute(newest).scalar()
        if last is not None:
            self._connection.execute(delete(delivery).where(mine, delivery.c.id <= last))

    def _deliveries(self, query: Any) -> builtins.list[DeliveryRecord]:
        rows: Sequence[RowMapping] = self._connection.execute(query).mappings().all()
        return [DeliveryRecord(**row) for row in rows]


def _record(row: RowMapping) -> WebhookRecord:
    values = {name: value for name, value in row.items() if name != "locations"}
    return WebhookRecord(**values, scope=Scope.loaded(row["locations"]))
