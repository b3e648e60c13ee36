"""/locations"""

from fastapi import APIRouter, Response

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import Admin, After, Audited, Ctx, FilteringOperator, Limit, Operator
from tidemap.api.scopes import check_name
from tidemap.api.views.locations import location_changes, location_view, new_location
from tidemap.schemas.common import Page
from tidemap.schemas.locations import Location, LocationForm, LocationPatch
from tidemap.services import locations

router = APIRouter(prefix="/locations", tags=["locations"], route_class=FormRoute)


@router.post("", status_code=201)
def create(form: LocationForm, ctx: Audited, _: Admin, response: Response) -> Location:
    """Make a location."""
    made = location_view(locations.create_location(ctx, new_location(form)))
    response.headers["Location"] = f"/api/v1/locations/{made.name}"
    return made


@router.get("")
def list_all(ctx: Ctx, who: FilteringOperator, limit: Limit = 100, after: After = None) -> Page[Location]:
    """All locations that the key may see, in order of their names."""
    items = [location_view(each) for each in locations.list_locations(ctx, after, limit + 1, who.scope)]
    return Page(items=items[:limit], next=items[limit - 1].name if len(items) > limit else None)


@router.get("/{name}")
def get(name: str, ctx: Ctx, _: Operator) -> Location:
    """One location with what is known of it."""
    return location_view(locations.get_location(ctx, name))


@router.patch("/{name}")
def change(name: str, form: LocationPatch, ctx: Audited, who: Admin) -> Location:
    """Change settings; the time base and the grid stay."""
    check_name(who, form.name or name)
    return location_view(locations.change_location(ctx, name, location_changes(form)))


@router.delete("/{name}", status_code=204)
def delete(name: str, ctx: Audited, _: Admin) -> None:
    """Delete a location with everything that belongs to it."""
    locations.delete_location(ctx, name)
