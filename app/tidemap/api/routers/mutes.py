"""/mutes"""

from fastapi import APIRouter

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import After, Audited, Ctx, FilteringOperator, Id, Limit, cursor
from tidemap.api.views.mutes import mute_view
from tidemap.errors import MuteNotFoundError, OutOfScopeError
from tidemap.schemas.common import Page
from tidemap.schemas.mutes import Mute, MuteForm
from tidemap.scope import Scope
from tidemap.services import mutes

router = APIRouter(prefix="/mutes", tags=["anomalies"], route_class=FormRoute)


@router.get("")
def list_all(ctx: Ctx, who: FilteringOperator, limit: Limit = 100, after: After = None) -> Page[Mute]:
    """When nobody hears of the events of some locations, and who wants that; in order of creation."""
    found = mutes.list_mutes(ctx, who.scope, cursor("after", after) or 0)
    shown = [mute_view(each) for each in found[:limit]]
    return Page(items=shown, next=str(shown[-1].id) if len(found) > limit else None)


@router.post("", status_code=201)
def create(form: MuteForm, ctx: Audited, who: FilteringOperator) -> Mute:
    """Let nobody hear of events in a time: they are stored, and listed as muted, but neither streamed nor sent."""
    scope = who.scope if form.locations is None else Scope.of(form.locations)
    if not who.scope.covers(scope):
        raise OutOfScopeError(f"The key {who.name!r} is limited to other locations than these.")
    new = mutes.NewMute(scope, form.start, form.stop, form.weekly, form.until, form.note)
    return mute_view(mutes.create_mute(ctx, new, who.name))


@router.delete("/{mute_id}", status_code=204)
def delete(mute_id: Id, ctx: Audited, who: FilteringOperator) -> None:
    """Hear of events again from now on. What it muted stays muted."""
    if not who.scope.covers(mutes.get_mute(ctx, mute_id).scope):
        raise MuteNotFoundError(mute_id)
    mutes.delete_mute(ctx, mute_id)
