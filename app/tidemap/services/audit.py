"""Audit: who changed what, stored together with the change."""

import secrets
from dataclasses import replace

from tidemap.services.context import Context
from tidemap.services.keys import Principal
from tidemap.storage.records import AuditEntry, AuditRecord

MAX_DETAIL = 2000
"""Characters of what was sent that are kept."""


def audited(ctx: Context, who: Principal, action: str, target: str, detail: str | None = None) -> Context:
    """The same context, whose writes come with an entry: neither is stored without the other."""
    entry = AuditEntry(
        request=secrets.token_hex(16),
        time=ctx.clock(),
        actor=who.name,
        key_id=who.key_id,
        action=action,
        target=target,
        detail=detail[:MAX_DETAIL] if detail else None,
    )
    return replace(ctx, store=ctx.store.guarded(lambda work: work.audit.append(entry)))


def list_entries(ctx: Context, before: int | None, limit: int) -> list[AuditRecord]:
    """Newest first; `before` is the last id of the page before."""
    with ctx.store.read() as work:
        return work.audit.list(before, limit)
