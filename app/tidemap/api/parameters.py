"""Parameters in an address: all of them are known, as the fields of a form are."""

from collections.abc import Callable, Collection, Coroutine, Iterable
from typing import Any

from fastapi.dependencies.utils import get_flat_params
from fastapi.params import ParamTypes
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from tidemap.api.auth import authenticate
from tidemap.errors import FieldError, InvalidInputError


def refuse_unknown(asked: Iterable[str], known: Collection[str]) -> None:
    """Raise InvalidInputError naming every parameter that is not known, and those that are."""
    advice = f"known are {', '.join(known)}" if known else "none is known here"
    unknown = [FieldError(name, f"this parameter is not known; {advice}") for name in asked if name not in known]
    if unknown:
        raise InvalidInputError(*unknown)


class StrictRoute(APIRoute):
    """A route whose query parameters are all known. A missing key, where one is needed, is reported first."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of a request with known parameters."""
        handle = super().get_route_handler()
        parameters = get_flat_params(self.dependant)
        asked_for = (each.alias for each in parameters if getattr(each.field_info, "in_", None) is ParamTypes.query)
        known = dict.fromkeys(asked_for).keys()

        async def handle_known(request: Request) -> Response:
            if request.scope["query_string"]:
                asked = request.query_params.keys()
                if not asked <= known:
                    await run_in_threadpool(authenticate, request)
                    refuse_unknown(asked, known)
            return await handle(request)

        return handle_known
