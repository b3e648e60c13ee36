"""What the kernels cost, each beside its floor, from the lines of `python -m tests.bench`."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from docs.paper.document import table
from tests.support.paths import ROOT

NEEDS: tuple[str, ...] = ()
FIGURES = ("update", "predict", "calendar", "selection", "year")
HEADER = ("figure", "work and floor", "unit", "value", "floor", "ratio", "aim", "details")
KNOWN = {"figure", "unit", "value", "floor", "ratio", "aim"}


def make(_images: Path) -> dict[str, str]:
    """One process measures all, as numbers of different runs cannot be compared. Half a minute."""
    command = [sys.executable, "-m", "tests.bench", *FIGURES]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    return {"cost": table(HEADER, (row(line) for line in lines))}


def row(line: dict[str, Any]) -> list[str]:
    """One JSON line as a row; the work is told by the docstring of the figure's module."""
    name = line["figure"]
    doc = (import_module(f"tests.bench.figures.{name}").__doc__ or "").strip()
    work = " ".join(doc.split("\n\n")[0].split()).partition(": ")[2].rstrip(".")
    details = ", ".join(f"{key} {value:,}" for key, value in line.items() if key not in KNOWN)
    figures = (
        f"{line[key]:,.4g}" if line[key] < 1000 else f"{line[key]:,.0f}" for key in ("value", "floor", "ratio", "aim")
    )
    return [name, work, line["unit"], *figures, details.replace("_", " ")]
