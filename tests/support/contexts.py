"""Services in this process, without a server: an open context, a clock to set, and posts."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tests.support.truth import Row, measurements_of
from tidemap.api.views.locations import new_location
from tidemap.formats.arrow import write
from tidemap.formats.registry import Body
from tidemap.history.history import History
from tidemap.history.measurements import Measurements
from tidemap.media_types import ARROW
from tidemap.schemas.locations import LocationForm
from tidemap.services.compaction import compact
from tidemap.services.context import Context, open_context
from tidemap.services.history import read_history
from tidemap.services.locations import LocationSummary, create_location, find_location
from tidemap.services.observe import observe
from tidemap.services.posts import Observed, Post
from tidemap.services.update import UpdateRequest, run_update
from tidemap.settings import Settings
from tidemap.storage.records import RevisionRecord
from tidemap.workers.compactor import Compactor
from tidemap.workers.election import LeaderElection
from tidemap.workers.updater import Updater
from tidemap.workers.watcher import Watcher
from tidemap.workers.webhooks import WebhookSender

AtWork = TypeVar("AtWork", LeaderElection, Updater, Compactor, Watcher, WebhookSender)
NOW = 1_700_000_000.0
"""A Tuesday, 22:13:20 UTC."""
EVER_S = 1e11
"""As `past_s`: tests measure from 1970 on."""


class Clock:
    """Stands still until somebody moves it."""

    def __init__(self, now: float = NOW) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


class Serial:
    """The simplest executor: one task after the other, here."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def map(self, run: Any, items: Iterable[Any]) -> Iterable[Any]:
        return (run(self.ctx, item) for item in items)

    def check(self) -> None:
        """It goes on."""


@contextmanager
def opened(url: str, clock: Clock | None = None, **settings: Any) -> Iterator[Context]:
    """A context whose updater, if a test starts one, only does what it is asked to; posts may be of any time."""
    chosen = Settings(database_url=url, **{"updater": False, "past_s": EVER_S, **settings})
    with open_context(chosen, clock or Clock()) as ctx:
        yield ctx


@contextmanager
def at_work(worker: AtWork) -> Iterator[AtWork]:
    """What works in the background, at work."""
    worker.start()
    try:
        yield worker
    finally:
        worker.stop()


def elected(ctx: Context) -> AbstractContextManager[LeaderElection]:
    """This process does the background work, unless another one does already."""
    return at_work(LeaderElection(ctx))


def make_location(ctx: Context, name: str = "lab", shape: Sequence[int] | None = None, **form: Any) -> LocationSummary:
    """A `state`, or a grid where a shape is given; samples of a minute unless told otherwise."""
    if shape is not None:
        form |= {"kind": f"grid{len(shape)}d", "grid": {"resolution_m": 0.5, "shape": list(shape)}}
    return create_location(ctx, new_location(LocationForm(**{"name": name, "interval_s": 60.0, **form})))


def arrow(measurements: Measurements, kind: str = "grid3d") -> Body:
    """The body of a post."""
    columns: dict[str, NDArray[Any]] = {
        "time": measurements.time,
        "cell": measurements.cell,
        "state": measurements.state,
    }
    if kind == "state":
        del columns["cell"]
    return Body(bytes(write({}, columns)), ARROW)


def post_rows(ctx: Context, name: str, rows: Iterable[Row], **post: Any) -> Observed:
    """Post measurements of a grid."""
    return observe(ctx, name, Post(arrow(measurements_of(rows)), **post))


def post_states(ctx: Context, name: str, time: Any, state: Any, **post: Any) -> Observed:
    """Post measurements of a `state`."""
    times = np.asarray(time, np.float64)
    columns = Measurements(times, np.zeros(len(times), np.uint32), np.asarray(state, np.uint8))
    return observe(ctx, name, Post(arrow(columns, "state"), **post))


def refit(ctx: Context, name: str = "lab", **request: Any) -> RevisionRecord:
    """An update, here and now."""
    return run_update(ctx, find_location(ctx, name).id, UpdateRequest(**request), Serial(ctx), lambda _: None)


def compact_now(ctx: Context, name: str = "lab") -> None:
    """A compaction, here and now."""
    compact(ctx, find_location(ctx, name))


def history_of(ctx: Context, name: str, chunk: int, start: int, stop: int) -> History:
    """What was observed in one chunk of a location over samples [start, stop)."""
    return read_history(ctx, find_location(ctx, name), chunk, start, stop)
