"""BLAS: its own threads kept out of small products, which they slow down tenfold on a busy machine.

Work is shared out over threads by whoever calls the core, chunk by chunk.
"""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

NAMES = ("scipy_openblas_set_num_threads64_", "openblas_set_num_threads64_", "openblas_set_num_threads")


@cache
def single_threaded() -> bool:
    """Once a process: the OpenBLAS that comes with numpy uses one thread. False where there is none."""
    folder = Path(np.__file__).parent.parent / "numpy.libs"
    for path in sorted(folder.glob("*openblas*")):
        library = ctypes.CDLL(str(path))
        for name in NAMES:
            if hasattr(library, name):
                getattr(library, name)(1)
                return True
    return False
