"""`python -m tests.bench [figure ...]`: one JSON line a figure, measured beside its floor.

A figure is a module in `tests/bench/figures` with `measure() -> Figure`; its name is the module's. Those that take
many minutes say `BY_NAME` and are measured when they are named.
"""

import json
import os
import sys
from importlib import import_module
from pathlib import Path

# Floors that are matrix products are those of one thread, as the work beside them is.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

FOLDER = Path(__file__).parent / "figures"


def main(chosen: list[str]) -> int:
    """0, or 2 where a name is not known. A ratio above its aim is a finding, not a failure."""
    known = sorted(path.stem for path in FOLDER.glob("*.py") if not path.stem.startswith("_"))
    if unknown := set(chosen) - set(known):
        sys.stderr.write(f"unknown figure {', '.join(sorted(unknown))}; known are {', '.join(known)}\n")
        return 2
    modules = {name: import_module(f"tests.bench.figures.{name}") for name in chosen or known}
    for name, module in modules.items():
        if name not in chosen and getattr(module, "BY_NAME", False):
            continue
        figure = module.measure()
        sys.stdout.write(json.dumps({"figure": name, **figure.line()}) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
