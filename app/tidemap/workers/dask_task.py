"""What travels in a Dask cluster: a task as bytes. The scheduler, which loads this module, opens none of them."""

import pickle
from collections.abc import Callable
from typing import Any

from distributed import get_worker

from tidemap.version import __version__

RESOURCE = f"tidemap-{__version__}"
"""What tasks ask for, so that other workers of a shared cluster, and those of another version, get none of them."""
PLUGIN = "tidemap-context"
"""The plugin of a worker that holds the context of its process, as `ctx`."""


def pack(run: Callable[..., Any], item: Any) -> bytes:
    """A function of a module and what it is to be called with after the context."""
    return pickle.dumps((run, item), pickle.HIGHEST_PROTOCOL)


def run_packed(task: bytes) -> Any:
    """Run a task with the context of the worker's process; what it returns."""
    run, item = pickle.loads(task)  # noqa: S301 - who reaches the scheduler may run anything
    return run(get_worker().plugins[PLUGIN].ctx, item)  # type: ignore[attr-defined]
