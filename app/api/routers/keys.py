"""/keys"""

from fastapi import APIRouter

from app.api.bodies import FormRoute
from app.api.dependencies import Admin, Ctx, Id
from app.schemas.common import Page
from app.schemas.keys import Key, KeyForm, NewKey
from app.services import keys

router = APIRouter(prefix="/keys", tags=["keys"], route_class=FormRoute)


@router.get("")
def list_all(ctx: Ctx, _: Admin) -> Page[Key]:
    """All keys, without their secrets."""
    return Page(items=keys.list_keys(ctx))


@router.post("", status_code=201)
def create(form: KeyForm, ctx: Ctx, _: Admin) -> NewKey:
    """Make a key; its secret is shown this once."""
    return keys.create_key(ctx, form.name, form.role)


@router.delete("/{key_id}", status_code=204)
def delete(key_id: Id, ctx: Ctx, _: Admin) -> None:
    """Revoke a key."""
    keys.delete_key(ctx, key_id)
