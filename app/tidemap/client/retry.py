"""Which requests to send again, and how often: exponential back-off with jitter, and the server's own Retry-After."""

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

import httpx

from tidemap.backoff import doubling
from tidemap.client.address import unreachable
from tidemap.client.errors import TidemapError, problem_of
from tidemap.client.plans import Attempts, Plan, Request, T

REFUSED = frozenset({408, 429, 503})
"""Statuses with which the server has done nothing: any request may be sent again."""
LOST = frozenset({502, 504})
"""Statuses of a gateway that cannot tell what the server has done: only what is repeatable is sent again."""
NEVER_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """At most `tries` attempts; pauses double from `first_s` up to `max_s` seconds, each cut by up to half.

    A server that asks for a pause longer than `max_s` is not waited for.
    """

    tries: int = 8
    first_s: float = 0.2
    max_s: float = 20.0

    def pauses(self) -> Iterator[float]:
        """Seconds to wait after each failed attempt, without end."""
        for pause_s in doubling(self.first_s, self.max_s):
            yield pause_s * random.uniform(0.5, 1.0)


def retried(plan: Plan[T], policy: RetryPolicy) -> Attempts[T]:
    """`plan`, with each of its requests tried again as long as that may help."""
    try:
        request = next(plan)
        while True:
            response = yield from retry(request, policy)
            request = plan.send(response)
    except StopIteration as stop:
        result: T = stop.value
        return result


def retry(request: Request, policy: RetryPolicy) -> Attempts[httpx.Response]:
    """The successful answer to `request`. Raises TidemapError when it was refused or nobody answered."""
    for attempt, pause_s in enumerate(policy.pauses(), start=1):
        reply = yield request
        if isinstance(reply, httpx.Response) and reply.is_success:
            return reply
        failure, passing = judge(request, reply)
        asked_s = failure.retry_after_s or 0.0
        if not passing or attempt >= policy.tries or asked_s > policy.max_s:
            raise failure
        request = replace(request, after_s=max(pause_s, asked_s))
    raise AssertionError("pauses never end")


def judge(request: Request, reply: httpx.Response | httpx.TransportError) -> tuple[TidemapError, bool]:
    """The error of a failed attempt, and whether trying again is safe and may help."""
    if isinstance(reply, httpx.TransportError):
        return unreachable(request.path, reply), request.repeatable or isinstance(reply, NEVER_SENT)
    status = reply.status_code
    return problem_of(reply), status in REFUSED or (status in LOST and request.repeatable)
