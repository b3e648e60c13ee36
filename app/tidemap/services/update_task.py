"""The tasks of an update: one chunk each, as plain data that any process can run with a context of its own."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from tidemap.errors import CorruptChunkError
from tidemap.services.context import Context
from tidemap.services.history import read_compacted
from tidemap.spectral.model import fit_part
from tidemap.spectral.outliers import count_outliers
from tidemap.spectral.recipe import Recipe
from tidemap.storage.records import LocationRecord
from tidemap.storage.work import Work

Item = TypeVar("Item")
Value = TypeVar("Value")


class Executor(Protocol):
    """Runs independent tasks, possibly at once and in other processes; results in the order of the items."""

    def map(self, run: Callable[[Context, Item], Value], items: Iterable[Item]) -> Iterable[Value]:
        """What `run`, a function of a module, returns for each item, given the context of the process it runs in."""
        ...

    def check(self) -> None:
        """Raises ShuttingDownError where nothing more is to be begun."""
        ...


@dataclass(frozen=True, slots=True)
class Plan:
    """What to fit. Samples [start, stop) are fitted; outliers are counted over `history`, samples [first, last)."""

    location: LocationRecord
    number: int
    recipe: Recipe
    start: int
    stop: int
    history: tuple[int, int]


@dataclass(frozen=True, slots=True)
class UpdateTask:
    """One chunk of an update. `term` is the leader's term, None where nobody competes for the work."""

    plan: Plan
    chunk: int
    term: int | None

    def __str__(self) -> str:
        return f"chunk {self.chunk} of location {self.plan.location.name!r}"


@dataclass(frozen=True, slots=True)
class ChunkFit:
    """How many samples of a chunk are outliers, and how many were observed."""

    outliers: int
    observed: int


def run_task(ctx: Context, task: UpdateTask) -> ChunkFit | CorruptChunkError:
    """Fit and store one chunk, unless its history is damaged: then the error is the result.

    To run a task again stores the same bytes. Raises NotLeaderError, storing nothing, once the task's term is over.
    """
    location, plan = task.plan.location, task.plan
    try:
        history = read_compacted(ctx, location, task.chunk, *plan.history)
    except CorruptChunkError as error:
        return error.with_traceback(None)
    spectrum = fit_part(history, plan.recipe, location.base, (plan.start, plan.stop))

    def store(work: Work) -> None:
        if task.term is not None:
            work.terms.confirm(task.term)
        work.spectra.put_chunk(location.id, plan.number, task.chunk, spectrum)

    ctx.store.write(store)
    outliers = count_outliers(spectrum, history, location.base)
    return ChunkFit(int(outliers.sum()), int(history.count_observed().sum()))
