"""Scopes of keys: whether what a request names is among the locations that a key is limited to."""

from collections.abc import Callable, Mapping

from fastapi import Request

from tidemap.api.state import state_of
from tidemap.errors import AnomalyNotFoundError, JobNotFoundError, NotFoundError, OutOfScopeError
from tidemap.services.anomalies import get_event
from tidemap.services.context import Context
from tidemap.services.jobs import get_job
from tidemap.services.keys import Principal

Find = Callable[[Context, int], str]
NUMBERED: Mapping[str, tuple[Find, type[NotFoundError]]] = {
    "anomaly_id": (lambda ctx, number: get_event(ctx, number).location, AnomalyNotFoundError),
    "job_id": (lambda ctx, number: get_job(ctx, number).location, JobNotFoundError),
}
"""The location of what a path names by number, and what there is not where it is out of scope."""


def check_name(principal: Principal, name: str) -> None:
    """Raises OutOfScopeError for a location that the principal may not see."""
    if not principal.scope.holds(name):
        raise OutOfScopeError(f"The key {principal.name!r} is limited to other locations than {name!r}.")


def check_scope(request: Request, principal: Principal) -> None:
    """Raises OutOfScopeError, or NotFoundError for a number, where a path names nothing that who asks may see."""
    if not principal.scope.limited:
        return
    named = request.path_params
    if "name" in named:
        check_name(principal, named["name"])
    elif numbers := NUMBERED.keys() & named.keys():
        _check_number(request, principal, numbers.pop())
    else:
        raise OutOfScopeError(f"The key {principal.name!r} is limited to some locations; this concerns all of them.")


def _check_number(request: Request, principal: Principal, parameter: str) -> None:
    find, missing = NUMBERED[parameter]
    given = request.path_params[parameter]
    # What is no number is nothing that anybody may see, however it would be read.
    if not (given.isascii() and given.isdigit() and len(given) < 19):
        raise missing(given)
    if not principal.scope.holds(find(state_of(request).ctx, int(given))):
        raise missing(given)
