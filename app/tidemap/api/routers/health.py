"""/healthz, /readyz and /metrics"""

from fastapi import APIRouter, Request
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from starlette.responses import JSONResponse, PlainTextResponse, Response

from tidemap.api.dependencies import Ctx, Operator
from tidemap.api.state import state_of
from tidemap.services.health import problems

router = APIRouter(tags=["health"])


@router.head("/healthz", include_in_schema=False)
@router.get("/healthz")
async def live() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.head("/readyz", include_in_schema=False)
@router.get("/readyz", responses={503: {"description": "`problems` says what is wrong."}})
def ready(request: Request, ctx: Ctx) -> JSONResponse:
    """The database, its schema and what works in the background are in order."""
    found = problems(ctx, state_of(request).alive)
    return JSONResponse({"status": "ok" if not found else "unavailable", "problems": found}, 503 if found else 200)


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(request: Request, _: Operator) -> Response:
    """Prometheus."""
    return Response(generate_latest(state_of(request).metrics), media_type=CONTENT_TYPE_LATEST)
