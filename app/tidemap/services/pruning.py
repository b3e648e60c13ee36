"""Pruning: what has served its time goes, a little at a time; histories, spectra and anomalies are never touched."""

from collections.abc import Callable
from itertools import product

from tidemap.services.context import Context
from tidemap.storage.work import Work

ROWS = 1000
"""Rows that one transaction deletes at most."""
KEPT_JOBS = 10
"""Finished jobs of a location that stay however old they are."""


def prune(ctx: Context, check: Callable[[], None] = lambda: None) -> int:
    """Delete idempotency keys, with the rows of the log that stood for them alone, scans and finished jobs; how many.

    All only after the time that the settings say. `check` is called between two transactions; what it raises ends
    this. Raises BusyError.
    """
    with ctx.store.read() as work:
        locations = list(work.locations.names())
    pruned = 0
    for location_id, step in product(locations, (_prune_log, _prune_scans, _prune_jobs)):
        deleted = ROWS
        while deleted == ROWS:
            check()
            deleted = step(ctx, location_id)
            pruned += deleted
    return pruned


def _prune_log(ctx: Context, location_id: int) -> int:
    before = ctx.clock() - ctx.settings.idempotency_s
    with ctx.store.read() as work:
        last = work.observations.prunable(location_id, before, ROWS)
    if last is None:
        return 0

    def prune(work: Work) -> int:
        work.sources.keep(location_id, last)
        return work.observations.prune(location_id, last)

    return ctx.store.write(prune)


def _prune_scans(ctx: Context, location_id: int) -> int:
    before = ctx.clock() - ctx.settings.scans_s
    with ctx.store.read() as work:
        old = work.scans.older(location_id, before, ROWS)
    return ctx.store.write(lambda work: work.scans.delete(location_id, old)) if old else 0


def _prune_jobs(ctx: Context, location_id: int) -> int:
    before = ctx.clock() - ctx.settings.jobs_s
    with ctx.store.read() as work:
        old = work.jobs.finished_before(location_id, before, KEPT_JOBS, ROWS)
    return ctx.store.write(lambda work: work.jobs.delete(location_id, old)) if old else 0
