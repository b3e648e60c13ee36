"""Questions: state, predict, series, model, evaluate."""

from dataclasses import replace
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response

from tidemap.api.auth import confirming
from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import Asker, Ctx, Operator, TimeQuery, query_time
from tidemap.api.encoding import (
    encode_answer,
    encode_density,
    encode_information,
    encode_prediction,
    encode_series,
    preferred,
    with_etag,
)
from tidemap.api.forms import form_body, posted_form
from tidemap.api.long_questions import Check, answered
from tidemap.api.tables import series_table
from tidemap.api.views.maps import evaluation_view, model_view
from tidemap.errors import InvalidInputError
from tidemap.media_types import ARROW, CSV, JSON, NPY
from tidemap.schemas import maps
from tidemap.schemas.locations import Confidence, EstimatorName
from tidemap.services.context import Context
from tidemap.services.density import DEFAULT_BINS, MAX_BINS, DensityQuery, density
from tidemap.services.evaluate import EvaluateQuery, evaluate
from tidemap.services.information import MAX_BEST, InformationQuery, information_at
from tidemap.services.locations import find_location
from tidemap.services.model import model_of
from tidemap.services.predict import PredictQuery, predict_at
from tidemap.services.series import SeriesQuery, series
from tidemap.services.state import Asked, StateQuery, ask
from tidemap.storage.records import LocationRecord

router = APIRouter(prefix="/locations/{name}", tags=["maps"], route_class=FormRoute)
Order = Annotated[int | None, Query(ge=0, le=64, description="Default: the revision's.")]
Box = Annotated[str | None, Query(description="x0,y0,z0,x1,y1,z1 in metres.")]
AsOf = Annotated[str | None, Query(description="Use the readings at or before this moment; by default now.")]
GivenQuery = Annotated[maps.Given, Query(description="model: the rhythm alone, whatever was read last.")]
Share = Annotated[float, Query(ge=0, le=1)]
Cell = Annotated[int, Query(description="Linear index in C order of the shape.")]


def _answers(model: Any, *binary: str) -> dict[int | str, dict[str, Any]]:
    content = {media_type: {"schema": {"type": "string", "format": "binary"}} for media_type in binary}
    return {200: {"model": model, "content": content}}


@router.get("/state", responses={**_answers(maps.StateAnswer, ARROW, NPY), 304: {}}, response_class=Response)
async def state(
    name: str,
    request: Request,
    ctx: Ctx,
    asker: Asker,
    time: TimeQuery = None,
    confidence: Annotated[Confidence | None, Query()] = None,
    order: Order = None,
    estimator: EstimatorName | None = None,
    bbox: Box = None,
    observed: Annotated[bool, Query(description="Add what was last seen at that time.")] = False,
    as_of: AsOf = None,
    given: GivenQuery = "observations",
    last_seen: Annotated[bool, Query(description="Add when each cell was read last, at or before `as_of`.")] = False,
) -> Response:
    """The state at a time, past or future, with a confidence, given what was read last; by default now."""
    seconds = query_time("time", time)
    query = StateQuery(
        ctx.clock() if seconds is None else seconds,
        confidence,
        order,
        estimator,
        _box(bbox),
        observed,
        query_time("as_of", as_of),
        given,
        last_seen,
    )
    answer = run_in_threadpool(lambda: _answer(request, ctx, ask(ctx, name, query, asker.claim)))
    return await confirming(request, asker, answer)


def _answer(request: Request, ctx: Context, asked: Asked) -> Response:
    media_type, facts = preferred(request, (JSON, ARROW, NPY)), asked.facts()
    encode = partial(encode_answer, ctx, asked, media_type)
    if asked.query.observed:
        return encode()
    query, read = replace(asked.query, as_of=None), asked.readings_version()
    model = (facts.location_id, facts.revision, asked.model.revision.recipe, facts.unavailable)
    key = (*model, query, media_type, facts.confidence, read)
    return with_etag(request, key, encode)


def _box(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        box = tuple(float(part) for part in text.split(","))
    except ValueError:
        box = ()
    if len(box) != 6 or not all(abs(value) < 1e12 for value in box):
        raise InvalidInputError.at("bbox", "give six numbers in metres: x0,y0,z0,x1,y1,z1")
    return box


@router.post(
    "/predict",
    responses=_answers(maps.PredictionAnswer),
    response_class=Response,
    openapi_extra=form_body(maps.PredictForm),
)
async def predict(name: str, request: Request, ctx: Ctx, _: Operator) -> Response:
    """Probability, state and entropy for many times."""
    form = await posted_form(request, maps.PredictForm)
    query = PredictQuery(**form.model_dump())
    return await answered(request, lambda check: encode_prediction(predict_at(ctx, name, query, check)))


@router.get("/series", responses=_answers(maps.SeriesAnswer, CSV), response_class=Response)
async def series_of(
    name: str,
    request: Request,
    ctx: Ctx,
    _: Operator,
    cell: Cell = 0,
    start: TimeQuery = None,
    stop: TimeQuery = None,
    step: Annotated[float | None, Query(gt=0, description="Seconds; default: interval_s.")] = None,
) -> Response:
    """One cell over [start, stop): what was predicted and what was observed."""
    query = SeriesQuery(cell, query_time("start", start), query_time("stop", stop), step)
    encode = series_table if preferred(request, (JSON, CSV)) == CSV else encode_series
    return await answered(request, lambda check: encode(series(ctx, name, query, check)))


@router.get("/density", responses={**_answers(maps.DensityAnswer), 304: {}}, response_class=Response)
async def density_of(
    name: str,
    request: Request,
    ctx: Ctx,
    _: Operator,
    start: TimeQuery = None,
    stop: TimeQuery = None,
    bins: Annotated[int, Query(ge=1, le=MAX_BINS, description="Steps at most.")] = DEFAULT_BINS,
) -> Response:
    """How much was observed when, in equal steps of [start, stop), by default of the whole history."""
    query = DensityQuery(query_time("start", start), query_time("stop", stop), bins)
    return await answered(request, lambda check: _counted(request, ctx, find_location(ctx, name), query, check))


def _counted(request: Request, ctx: Context, location: LocationRecord, query: DensityQuery, check: Check) -> Response:
    posted = (location.first_time, location.observation_seq, location.compacted_seq, location.deleted)
    key = (location.id, location.interval_s, posted, query)
    return with_etag(request, key, lambda: encode_density(density(ctx, location, query, check)))


@router.get("/information", responses=_answers(maps.InformationAnswer), response_class=Response)
async def information(
    name: str,
    request: Request,
    ctx: Ctx,
    _: Operator,
    time: TimeQuery = None,
    start: TimeQuery = None,
    stop: TimeQuery = None,
    step: Annotated[float | None, Query(gt=0, description="Seconds; default: 288 times at most.")] = None,
    bbox: Box = None,
    best: Annotated[int, Query(ge=0, le=MAX_BEST, description="How many of the best times of the window.")] = 0,
    miss: Annotated[
        Share | None,
        Query(description="How often a look says free of an occupied cell; by default as the sensor does."),
    ] = None,
    false_alarm: Annotated[
        Share | None, Query(description="How often a look says occupied of a free cell; by default as the sensor does.")
    ] = None,
    as_of: AsOf = None,
    given: GivenQuery = "observations",
) -> Response:
    """What looking at a region is expected to say, at a time (by default now) or over [start, stop), and when to look.

    Any of start, stop, step and best asks for a window; by default it is the next day.
    """
    query = InformationQuery(
        time=query_time("time", time),
        start=query_time("start", start),
        stop=query_time("stop", stop),
        step=step,
        bbox=_box(bbox),
        best=best,
        miss=miss,
        false_alarm=false_alarm,
        as_of=query_time("as_of", as_of),
        given=given,
    )
    return await answered(request, lambda check: encode_information(information_at(ctx, name, query, check)))


@router.get("/model")
async def model(name: str, request: Request, ctx: Ctx, _: Operator, cell: Cell = 0, order: Order = None) -> maps.Model:
    """The spectrum and the outliers of one cell; `order` recomputes without storing."""
    return await answered(request, lambda check: model_view(model_of(ctx, name, cell, order)))


@router.post("/evaluate", openapi_extra=form_body(maps.EvaluateForm))
async def evaluation(name: str, request: Request, ctx: Ctx, _: Operator) -> maps.Evaluation:
    """Score estimators and orders against the history or the measurements given."""
    form = await posted_form(request, maps.EvaluateForm)
    query = EvaluateQuery(**form.model_dump())
    return await answered(request, lambda check: evaluation_view(evaluate(ctx, name, query, check)))
