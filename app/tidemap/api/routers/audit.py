"""/audit"""

from dataclasses import asdict

from fastapi import APIRouter

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import Admin, After, Ctx, Limit, cursor
from tidemap.schemas.audit import AuditItem
from tidemap.schemas.common import Page
from tidemap.services.audit import list_entries

router = APIRouter(prefix="/audit", tags=["keys"], route_class=FormRoute)


@router.get("")
def list_all(ctx: Ctx, _: Admin, limit: Limit = 100, after: After = None) -> Page[AuditItem]:
    """Who changed what, newest first; kept for two years."""
    entries = list_entries(ctx, cursor("after", after), limit + 1)
    items = [AuditItem(**asdict(entry)) for entry in entries[:limit]]
    return Page(items=items, next=str(items[-1].id) if len(entries) > limit else None)
