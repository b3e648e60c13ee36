"""`python -m docs.paper [part ...]`: all parts, or some, written into docs/method.md and docs/images/paper."""

import os
import sys
from importlib import import_module

from docs.paper.document import IMAGES, PAGE, write
from docs.paper.recordings import missing

# Many small fits one after the other: threads would wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

PARTS = ("waves", "reproduction", "published", "rooms", "clocks", "things", "horizons", "costs", "laboratory")


def main(chosen: list[str]) -> int:
    """0, or 2 where a part is not known. Parts whose recordings are missing are skipped, and it says so."""
    if unknown := set(chosen) - set(PARTS):
        sys.stderr.write(f"unknown part {', '.join(sorted(unknown))}; known are {', '.join(PARTS)}\n")
        return 2
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name in PARTS:
        if not chosen or name in chosen:
            sys.stdout.write(f"{name}: {made(name)}\n")
            sys.stdout.flush()
    return 0


def made(name: str) -> str:
    """Make one part; what became of it."""
    part = import_module(f"docs.paper.{name}")
    if absent := missing(part.NEEDS):
        return f"skipped, as ../shared/data lacks {', '.join(absent)}"
    bodies = part.make(IMAGES)
    write(PAGE, bodies)
    return f"wrote {', '.join(bodies)}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
