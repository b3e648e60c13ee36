"""Methods written once as plans: they block on blocking resources and are awaited on asynchronous ones."""

import functools
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, Protocol, TypeAlias, TypeVar, cast, overload

from tidemap.client.plans import Listing, Plan
from tidemap.client.posting import Postable, Queued, Receipt
from tidemap.schemas.observations import Accepted
from tidemap.schemas.scans import ScanAccepted

if TYPE_CHECKING:
    # Python 3.13 has defaults of its own.
    from typing_extensions import TypeVar as DefaultTypeVar

    R = DefaultTypeVar("R", bound=Receipt, default=Accepted)
else:
    R = TypeVar("R")

P = ParamSpec("P")
T = TypeVar("T")
B_co = TypeVar("B_co", covariant=True)
A_co = TypeVar("A_co", covariant=True)


class BlockingCarrier(Protocol):
    """Carries the requests of a plan and returns when they are done."""

    def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""

    def post(self, post: Postable) -> Receipt:
        """Send the measurements, or queue them where there is an outbox."""


class AwaitedCarrier(Protocol):
    """Carries the requests of a plan without blocking."""

    async def run(self, plan: Plan[T]) -> T:
        """What the plan comes to."""

    async def post(self, post: Postable) -> Receipt:
        """Send the measurements, or queue them where there is an outbox."""


class Resource:
    """A place in the API, such as `/locations/office-door`: what operations work on."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.path!r})"


class Blocking(Resource):
    """A resource whose operations return when they are done."""

    def __init__(self, path: str, carrier: BlockingCarrier) -> None:
        super().__init__(path)
        self.carrier = carrier


class Awaited(Resource):
    """A resource whose operations are awaited."""

    def __init__(self, path: str, carrier: AwaitedCarrier) -> None:
        super().__init__(path)
        self.carrier = carrier


class BlockingPoster(Blocking, Generic[R]):
    """A blocking resource that measurements are posted to, with the receipt R."""


class AwaitedPoster(Awaited, Generic[R]):
    """An awaited resource that measurements are posted to, with the receipt R."""


Either: TypeAlias = Blocking | Awaited


class Method(Protocol[P, B_co, A_co]):
    """A method as a type checker sees it: it returns B on blocking resources and A on awaited ones."""

    @overload
    def __get__(self, at: None, owner: type) -> Callable[Concatenate[Any, P], B_co | A_co]: ...
    @overload
    def __get__(self, at: Blocking, owner: type) -> Callable[P, B_co]: ...
    @overload
    def __get__(self, at: Awaited, owner: type) -> Callable[P, A_co]: ...


class PostMethod(Protocol[P]):
    """A posting method as a type checker sees it: its receipt is that of the resource."""

    @overload
    def __get__(self, at: None, owner: type) -> Callable[Concatenate[Any, P], Any]: ...
    @overload
    def __get__(self, at: BlockingPoster[R], owner: type) -> Callable[P, R]: ...
    @overload
    def __get__(self, at: AwaitedPoster[R], owner: type) -> Callable[P, Coroutine[Any, Any, R]]: ...


class ScanMethod(Protocol[P]):
    """A method that posts scans as a type checker sees it: its receipt is that of the resource, for scans."""

    @overload
    def __get__(self, at: None, owner: type) -> Callable[Concatenate[Any, P], Any]: ...
    @overload
    def __get__(self, at: BlockingPoster[Accepted], owner: type) -> Callable[P, ScanAccepted]: ...
    @overload
    def __get__(self, at: BlockingPoster[Queued], owner: type) -> Callable[P, Queued]: ...
    @overload
    def __get__(self, at: AwaitedPoster[Accepted], owner: type) -> Callable[P, Coroutine[Any, Any, ScanAccepted]]: ...
    @overload
    def __get__(self, at: AwaitedPoster[Queued], owner: type) -> Callable[P, Coroutine[Any, Any, Queued]]: ...


def operation(plan: Callable[Concatenate[Any, P], Plan[T]]) -> Method[P, T, Coroutine[Any, Any, T]]:
    """A plan as a method."""

    @functools.wraps(plan)
    def method(at: Either, /, *args: P.args, **kwargs: P.kwargs) -> T | Coroutine[Any, Any, T]:
        return at.carrier.run(plan(at, *args, **kwargs))

    return cast(Method[P, T, Coroutine[Any, Any, T]], method)


def posting(describe: Callable[Concatenate[Any, P], Postable]) -> PostMethod[P]:
    """What is to be posted as a method that posts it."""

    @functools.wraps(describe)
    def method(at: Either, /, *args: P.args, **kwargs: P.kwargs) -> Receipt | Coroutine[Any, Any, Receipt]:
        return at.carrier.post(describe(at, *args, **kwargs))

    return cast(PostMethod[P], method)


def scanning(describe: Callable[Concatenate[Any, P], Postable]) -> ScanMethod[P]:
    """As `posting`, of scans."""
    return cast(ScanMethod[P], posting(describe))


def paged(listing: Callable[Concatenate[Any, P], Listing[T]]) -> Method[P, Iterator[T], AsyncIterator[T]]:
    """A listing as a method that fetches pages as they are needed."""

    @functools.wraps(listing)
    def method(at: Either, /, *args: P.args, **kwargs: P.kwargs) -> Iterator[T] | AsyncIterator[T]:
        pages = listing(at, *args, **kwargs)
        return _items(pages, at.carrier) if isinstance(at, Blocking) else _awaited_items(pages, at.carrier)

    return cast(Method[P, Iterator[T], AsyncIterator[T]], method)


def _items(pages: Listing[T], carrier: BlockingCarrier) -> Iterator[T]:
    while not pages.finished:
        yield from carrier.run(pages.next_page())


async def _awaited_items(pages: Listing[T], carrier: AwaitedCarrier) -> AsyncIterator[T]:
    while not pages.finished:
        for item in await carrier.run(pages.next_page()):
            yield item
