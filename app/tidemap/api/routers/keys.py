"""/keys"""

from fastapi import APIRouter

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import Admin, After, Audited, Ctx, Id, Limit, cursor
from tidemap.api.views.keys import key_view, new_key_view
from tidemap.schemas.common import Page
from tidemap.schemas.keys import Key, KeyForm, NewKey, RotationForm
from tidemap.scope import Scope
from tidemap.services import keys

router = APIRouter(prefix="/keys", tags=["keys"], route_class=FormRoute)


@router.get("")
def list_all(ctx: Ctx, _: Admin, limit: Limit = 100, after: After = None) -> Page[Key]:
    """Keys without their secrets, in order of creation."""
    items = [key_view(key) for key in keys.list_keys(ctx, cursor("after", after), limit + 1)]
    return Page(items=items[:limit], next=str(items[limit - 1].id) if len(items) > limit else None)


@router.post("", status_code=201)
def create(form: KeyForm, ctx: Audited, _: Admin) -> NewKey:
    """Make a key; its secret is shown this once."""
    return new_key_view(keys.create_key(ctx, form.name, form.role, Scope.of(form.locations), form.expires_at))


@router.post("/{key_id}/rotate", status_code=201)
def rotate(key_id: Id, ctx: Audited, _: Admin, form: RotationForm | None = None) -> NewKey:
    """Make another key like this one, which itself expires after the overlap: time to bring the new one to its user."""
    return new_key_view(keys.rotate_key(ctx, key_id, (form or RotationForm()).overlap_s))


@router.delete("/{key_id}", status_code=204)
def delete(key_id: Id, ctx: Audited, _: Admin) -> None:
    """Revoke a key."""
    keys.delete_key(ctx, key_id)
