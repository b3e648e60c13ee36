"""The repository of the audit log: who changed what."""

from dataclasses import asdict

from sqlalchemy import Connection, delete, insert, select

from tidemap.storage.counters import take
from tidemap.storage.records import AuditEntry, AuditRecord
from tidemap.storage.tables import audit

KEPT_S = 2 * 365 * 86400.0
"""Older entries go."""


class AuditRepository:
    """Entries in the order in which they were committed, which is that of their ids."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def append(self, entry: AuditEntry) -> None:
        """Store an entry, once for each request: a change may be made of several writes, and a write be run again."""
        if self._connection.execute(select(audit.c.id).where(audit.c.request == entry.request)).first() is None:
            self._connection.execute(delete(audit).where(audit.c.time < entry.time - KEPT_S))
            self._connection.execute(insert(audit).values(id=take(self._connection, "audit"), **asdict(entry)))

    def list(self, before: int | None, limit: int) -> list[AuditRecord]:
        """Newest first; `before` is the last id of the page before."""
        query = select(audit).order_by(audit.c.id.desc()).limit(limit)
        if before is not None:
            query = query.where(audit.c.id < before)
        return [AuditRecord(**row) for row in self._connection.execute(query).mappings()]
