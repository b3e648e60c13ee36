"""Waiting for jobs."""

import math
import time

from tidemap.backoff import doubling
from tidemap.client.plans import Plan, Request, ask
from tidemap.schemas.jobs import Job

FINISHED = frozenset({"done", "failed", "cancelled"})
MAX_WAIT_S = 20.0
"""How long one request may wait for a job; longer waits ask again."""


def until(wait: bool | float) -> float:
    """The deadline (time.monotonic) of a wait: without end (True), none (False) or so many seconds."""
    return time.monotonic() + (math.inf if wait is True else wait)


def wait_s(deadline: float) -> float:
    """Seconds that one request may wait for a job that is waited for until `deadline`."""
    return round(min(max(deadline - time.monotonic(), 0.0), MAX_WAIT_S), 3)


def ended(job: Job, deadline: float) -> Plan[Job]:
    """The job as soon as it has ended, or as it is at `deadline` (time.monotonic)."""
    pauses = doubling(0.1, 2.0)
    while job.state not in FINISHED and time.monotonic() < deadline:
        job = yield from ask(Job, Request("GET", f"/jobs/{job.id}", after_s=min(next(pauses), wait_s(deadline))))
    return job
