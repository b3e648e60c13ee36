"""Calls as plans: generators that yield requests and are sent the answers, and so know no sockets.

One plan serves the blocking and the asynchronous client; each of them only carries requests to the server.
"""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeAlias, TypeVar

import httpx
from pydantic import BaseModel

from tidemap.schemas.common import Page

T = TypeVar("T")
F = TypeVar("F", bound=BaseModel)

Scalar: TypeAlias = str | int | float | bool


@dataclass(frozen=True, slots=True)
class Request:
    """One HTTP request below the API's base, to be sent after a pause of `after_s` seconds.

    `repeatable`: sending it twice does what sending it once does; it is sent again when no answer came.
    `waits_s`: how long the server may wait for something before it answers.
    """

    method: str
    path: str
    query: Mapping[str, Scalar] = field(default_factory=dict)
    content: bytes | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    repeatable: bool = True
    after_s: float = 0.0
    waits_s: float = 0.0

    def arguments(self) -> dict[str, Any]:
        """As keyword arguments of `httpx.Client.request`."""
        named = {"method": self.method, "url": self.path, "params": self.query}
        return named | {"content": self.content, "headers": self.headers}


Reply: TypeAlias = httpx.Response | httpx.TransportError
Plan: TypeAlias = Generator[Request, httpx.Response, T]
Attempts: TypeAlias = Generator[Request, Reply, T]


class Run(Generic[T]):
    """A plan on its way: `request` is what it wants next, None when `result` is there."""

    request: Request | None
    result: T

    def __init__(self, plan: Attempts[T]) -> None:
        self._plan = plan
        self._advance(None)

    def send(self, reply: Reply) -> None:
        """Give the plan what came of its request. Raises what the plan raises."""
        self._advance(reply)

    def _advance(self, reply: Reply | None) -> None:
        try:
            self.request = next(self._plan) if reply is None else self._plan.send(reply)
        except StopIteration as stop:
            self.request = None
            self.result = stop.value


def ask(form: type[F], request: Request) -> Plan[F]:
    """The answer to `request`, read as `form`."""
    response = yield request
    return form.model_validate_json(response.content)


class Listing(Generic[T]):
    """A list of the server read page by page, from after the cursor `after` to its end."""

    def __init__(self, page: type[Page[T]], path: str, query: Mapping[str, Scalar]) -> None:
        self._page = page
        self._path = path
        self._query = dict(query)
        self.finished = False

    def next_page(self) -> Plan[list[T]]:
        """The items of the next page."""
        page = yield from ask(self._page, Request("GET", self._path, dict(self._query)))
        self.finished = page.next is None
        if page.next is not None:
            self._query["after"] = page.next
        return page.items

    def everything(self) -> Plan[list[T]]:
        """All items of all pages."""
        items: list[T] = []
        while not self.finished:
            items += yield from self.next_page()
        return items
