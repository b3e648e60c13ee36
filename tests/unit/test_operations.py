"""docs/operations.md is held to the settings, the log and the metrics that it tells of."""

import re
from pathlib import Path

from prometheus_client import generate_latest

from docs.settings_table import PAGE, page
from tests.support.documents import spans
from tests.support.paths import ROOT
from tidemap.api.metrics import Listeners, RequestMetrics, make_registry
from tidemap.services.context import Context


def test_the_table_is_that_of_the_settings() -> None:
    assert PAGE.read_text() == page(), "run: python -m docs.settings_table"


def test_its_metrics_exist(ctx: Context) -> None:
    registry = make_registry(ctx)
    Listeners(registry)
    RequestMetrics(None, registry)  # type: ignore[arg-type]
    known = set(re.findall(r"^# TYPE (\w+)", generate_latest(registry).decode(), re.MULTILINE))
    told = {span for span in spans(PAGE) if span.startswith(("tidemap_", "process_"))}
    assert told <= known
    assert len(told) == 19


def test_its_log_lines_exist() -> None:
    code = "\n".join(path.read_text() for path in Path(ROOT / "app").rglob("*.py"))
    table = PAGE.read_text().split("| line in the log |")[1].split("\n\n")[0]
    lines = re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)
    assert len(lines) == 11
    for line in lines:
        # Which of the two it cannot be is filled in.
        assert re.sub("(written|read)$", "%s", line) in code or line in code, line
