"""/jobs and /locations/{name}/update"""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from tidemap.api.bodies import FormRoute
from tidemap.api.dependencies import After, Audited, Ctx, FilteringOperator, Id, Limit, Operator, cursor
from tidemap.api.views.jobs import job_view
from tidemap.api.waiting import wait_for_job
from tidemap.schemas.common import Page
from tidemap.schemas.jobs import Job, UpdateForm
from tidemap.services import jobs
from tidemap.services.update import UpdateRequest

router = APIRouter(tags=["jobs"], route_class=FormRoute)
Wait = Annotated[float, Query(ge=0, le=300, description="Seconds to wait for the end.")]


@router.post("/locations/{name}/update", status_code=202, responses={200: {"model": Job}})
async def update(
    name: str,
    ctx: Ctx,
    _: Operator,
    request: Request,
    response: Response,
    form: UpdateForm | None = None,
    wait: Wait = 0,
) -> Job:
    """Refit a location; 202 with a job, or 200 with the finished job when it ended within `wait`."""
    wanted = UpdateRequest(**(form or UpdateForm()).model_dump())
    job = await wait_for_job(request, lambda: jobs.request_update(ctx, name, wanted), wait)
    if job.finished_at is not None:
        response.status_code = 200
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    return job_view(job)


@router.get("/jobs")
def list_all(ctx: Ctx, who: FilteringOperator, limit: Limit = 100, after: After = None) -> Page[Job]:
    """Jobs, newest first."""
    items = [job_view(job) for job in jobs.list_jobs(ctx, cursor("after", after), limit + 1, who.scope)]
    return Page(items=items[:limit], next=str(items[limit - 1].id) if len(items) > limit else None)


@router.get("/jobs/{job_id}")
async def get(job_id: Id, ctx: Ctx, _: Operator, request: Request, wait: Wait = 0) -> Job:
    """One job, when it has ended or after `wait` seconds."""
    return job_view(await wait_for_job(request, lambda: jobs.get_job(ctx, job_id), wait))


@router.delete("/jobs/{job_id}")
def cancel(job_id: Id, ctx: Audited, _: Operator) -> Job:
    """Cancel a queued job."""
    return job_view(jobs.cancel_job(ctx, job_id))
