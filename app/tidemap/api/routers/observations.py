"""/locations/{name}/observations"""

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response

from tidemap.api.auth import confirming
from tidemap.api.dependencies import Admin, Audited, RequiredTime, Robot, posted_body
from tidemap.api.long_questions import answered
from tidemap.api.parameters import StrictRoute
from tidemap.api.state import state_of
from tidemap.api.views.observations import accepted_view
from tidemap.media_types import ARROW, JSON, NPY
from tidemap.schemas.common import Text
from tidemap.schemas.observations import Accepted, Deleted, GridObservations, Layout, StateObservations
from tidemap.services.deletion import Deletion, delete_observations
from tidemap.services.keys import Principal
from tidemap.services.observe import submit
from tidemap.services.posts import Post
from tidemap.services.refusals import counting

Source = Annotated[Text | None, Query(max_length=128, description="The robot's name.")]
IdempotencyKey = Annotated[str | None, Header(alias="Idempotency-Key", min_length=1, max_length=255)]
router = APIRouter(prefix="/locations/{name}/observations", tags=["observations"], route_class=StrictRoute)

_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "description": "Columns of measurements. May be gzip- or zstd-encoded (Content-Encoding), "
        "zstd with a window of 8 MB at most.",
        "content": {
            JSON: {
                "schema": {
                    "anyOf": [
                        {"$ref": f"#/components/schemas/{form.__name__}"}
                        for form in (StateObservations, GridObservations)
                    ]
                },
                "examples": {
                    "state": {
                        "summary": "kind state",
                        "value": {"time": [1772355600, "2026-03-01T09:01:00Z"], "state": [0, 1]},
                    },
                    "grid": {
                        "summary": "grids",
                        "value": {
                            "observations": [{"time": 1772355600, "occupied": [17, [3, 4, 0]], "free": [18, 19]}]
                        },
                    },
                },
            },
            ARROW: {
                "schema": {
                    "type": "string",
                    "format": "binary",
                    "description": "An Arrow IPC stream with columns time (float64 Unix seconds, or timestamp with a "
                    "zone), cell (uint32; not for kind state) and state (uint8 or bool).",
                }
            },
            NPY: {
                "schema": {
                    "type": "string",
                    "format": "binary",
                    "description": "What numpy.save writes of a structured array, one row a measurement, with fields "
                    "time (float64 Unix seconds), cell (uint32; not for kind state) and state (uint8 or bool): "
                    "numpy.zeros(n, [('time', 'f8'), ('cell', 'u4'), ('state', 'u1')]). Or, with `?time=`, of a whole "
                    "grid at that time: uint8, int8 or bool of the location's shape, or flat (n_cells,) in C order, "
                    "with 0 free, 1 occupied, 255 or -1 not seen.",
                }
            },
        },
    }
}


@router.post("", status_code=201, openapi_extra=_BODY, response_model=Accepted, responses={200: {"model": Accepted}})
async def post(
    name: str,
    robot: Robot,
    request: Request,
    source: Source = None,
    time: Annotated[
        str | None, Query(description="When a grid (npy) was seen; required for it, and for it alone.")
    ] = None,
    layout: Annotated[
        Layout | None,
        Query(
            description="Of a grid (npy): `ros` for that of nav_msgs/OccupancyGrid, (ny, nx) rows along x from the "
            "lower left on, 65 to 100 occupied, 0 to 25 free, others and -1 not seen."
        ),
    ] = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Post measurements; answered after their durable commit.

    The same Idempotency-Key with the same body again is answered 200 with `duplicate` true; nothing is stored twice.
    """
    state, source = state_of(request), source or name_of(robot.principal)
    with state.budget.share() as share, counting(state.ctx, name, source):
        body = await posted_body(request, time, layout, share)
        sent = Post(body, source, idempotency_key, robot.claim)
        result = await confirming(request, robot, submit(state.ctx, name, sent))
    return Response(accepted_view(result).model_dump_json(), 200 if result.duplicate else 201, media_type=JSON)


@router.delete("")
async def delete(
    name: str,
    request: Request,
    ctx: Audited,
    admin: Admin,
    start: RequiredTime,
    stop: RequiredTime,
    source: Annotated[
        Text | None, Query(min_length=1, max_length=128, description="The robot's name; default: of all of them.")
    ] = None,
) -> Deleted:
    """Delete what was measured in [start, stop): all of it or, where something is wrong, nothing.

    Of a source alone what can be told apart: where its measurements are compacted together with those of others, that
    is refused (422). The model learns of it with its next update.
    """
    what = Deletion(start, stop, source)
    work = partial(delete_observations, ctx, name, what, by=admin.name)
    return Deleted(deleted=await answered(request, lambda check: work(check=check)))


def name_of(robot: Principal) -> str | None:
    """A robot that does not say its name goes by its key's."""
    return None if robot.key_id is None else robot.name
