"""Maps as files."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from tidemap.api.dependencies import Ctx, Operator, TimeQuery, query_time
from tidemap.api.long_questions import answered
from tidemap.api.parameters import StrictRoute
from tidemap.formats.map_files import BINARY, ZIP
from tidemap.media_types import ARROW
from tidemap.schemas.common import iso
from tidemap.schemas.locations import Confidence
from tidemap.schemas.maps import ExportFormat, ExportMode, ExportSource, Given
from tidemap.services.export import ExportedMap, ExportQuery, export_map

router = APIRouter(prefix="/locations/{name}", tags=["maps"], route_class=StrictRoute)
MAX_NAMED_RANGES = 100
"""Ranges of damaged cells that a header names."""
_FILE = {"schema": {"type": "string", "format": "binary"}}
_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The file; its name is in `Content-Disposition`.",
        "content": {ZIP: _FILE, BINARY: _FILE, ARROW: _FILE},
        "headers": {
            "Content-Disposition": {"description": "The name of the file.", "schema": {"type": "string"}},
            "Tidemap-Time": {"description": "The time of the map.", "schema": {"type": "string"}},
            "Tidemap-Revision": {"description": "The revision, 0 without a model.", "schema": {"type": "string"}},
            "Tidemap-Unavailable": {
                "description": "Ranges `first-stop` of cells that are damaged and look unknown; left out without any.",
                "schema": {"type": "string"},
            },
        },
    }
}
Metres = Annotated[float | None, Query(ge=-1e12, le=1e12, description="Of the height band, in metres.")]


@router.get("/export", responses=_ANSWERS, response_class=Response)
async def export(
    name: str,
    request: Request,
    ctx: Ctx,
    _: Operator,
    format: Annotated[ExportFormat, Query(description="nav2: a zip of a picture and its YAML.", examples=["nav2"])],
    time: TimeQuery = None,
    confidence: Annotated[Confidence | None, Query(description="Default: the location's.")] = None,
    source: Annotated[
        ExportSource, Query(description="observed: what was seen last of each cell; it needs no model.")
    ] = "predicted",
    mode: Annotated[
        ExportMode, Query(description="trinary: occupied, free or unknown by confidence; scale: probabilities.")
    ] = "trinary",
    given: Annotated[Given, Query(description="Of a predicted map, as for `state`.")] = "observations",
    z_min: Metres = None,
    z_max: Metres = None,
) -> Response:
    """The map at a time (by default now) as a file that other programs load.

    A height band [z_min, z_max] keeps the layers with their centre in it. Nav2's maps are flat: a column is occupied
    where any of its cells is, free where all that are known are, and else unknown.
    """
    seconds = query_time("time", time)
    query = ExportQuery(
        format=format,
        time=ctx.clock() if seconds is None else seconds,
        mode=mode,
        source=source,
        confidence=confidence,
        given=given,
        z_min=z_min,
        z_max=z_max,
    )
    return _response(await answered(request, lambda check: export_map(ctx, name, query, check)))


def _response(file: ExportedMap) -> Response:
    headers = {
        "Content-Disposition": f'attachment; filename="{file.name}"',
        "Tidemap-Time": iso(file.time),
        "Tidemap-Revision": str(file.revision),
    }
    if file.unavailable:
        named = file.unavailable[:MAX_NAMED_RANGES]
        headers["Tidemap-Unavailable"] = ", ".join(f"{first}-{stop}" for first, stop in named)
    return Response(file.content, headers=headers, media_type=file.media_type)
