"""How long to go on trying: exponential backoff with jitter, and the server's own Retry-After."""

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

import httpx

from tidemap.client.errors import TidemapError, UnreachableError, problem_of
from tidemap.client.plans import Attempts, Plan, Request, T

REFUSED = frozenset({408, 429, 503})
"""Statuses with which the server has done nothing: any request may be sent again."""
LOST = frozenset({502, 504})
"""Statuses of a gateway that cannot tell what the server has done: only what is repeatable is sent again."""
NEVER_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)


@dataclass(frozen=True, slots=True)
class Patience:
    """At most `tries` attempts; pauses double from `first_s` up to `most_s` seconds, each cut by up to half.

    A server that asks for a pause longer than `most_s` is not waited for.
    """

    tries: int = 8
    first_s: float = 0.2
    most_s: float = 20.0

    def pauses(self) -> Iterator[float]:
        """Seconds to wait after each failed attempt, without end."""
        pause_s = self.first_s
        while True:
            yield pause_s * random.uniform(0.5, 1.0)
            pause_s = min(2 * pause_s, self.most_s)


def persistent(plan: Plan[T], patience: Patience) -> Attempts[T]:
    """`plan`, with each of its requests tried again as long as that may help."""
    try:
        request = next(plan)
        while True:
            response = yield from insist(request, patience)
            request = plan.send(response)
    except StopIteration as stop:
        result: T = stop.value
        return result


def insist(request: Request, patience: Patience) -> Attempts[httpx.Response]:
    """The successful answer to `request`. Raises TidemapError when it was refused or nobody answered."""
    for attempt, pause_s in enumerate(patience.pauses(), start=1):
        reply = yield request
        if isinstance(reply, httpx.Response) and reply.is_success:
            return reply
        failure, passing = judge(request, reply)
        asked_s = failure.retry_after_s or 0.0
        if not passing or attempt >= patience.tries or asked_s > patience.most_s:
            raise failure
        request = replace(request, after_s=max(pause_s, asked_s))
    raise AssertionError("pauses never end")


def judge(request: Request, reply: httpx.Response | httpx.TransportError) -> tuple[TidemapError, bool]:
    """The error of a failed attempt, and whether trying again is safe and may help."""
    if isinstance(reply, httpx.TransportError):
        return UnreachableError(request.path, reply), request.repeatable or isinstance(reply, NEVER_SENT)
    status = reply.status_code
    return problem_of(reply), status in REFUSED or (status in LOST and request.repeatable)
