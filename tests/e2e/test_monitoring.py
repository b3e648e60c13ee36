"""The files for Prometheus, Grafana and systemd are held to a running server and to the programs that read them."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import yaml

from tests.support.paths import ROOT
from tests.support.programs import program
from tests.support.server import ServerProcess

PROMETHEUS = ROOT / "docker" / "prometheus"
RULES = PROMETHEUS / "tidemap.rules.yml"
DASHBOARD = ROOT / "docker" / "grafana" / "tidemap.json"
UNIT = ROOT / "docker" / "systemd" / "tidemap.service"
NAME = re.compile(r"\b(?:tidemap|process|python)_[a-z_]+")
MADE_BY_PROMETHEUS = {"up"}


@pytest.fixture(scope="module")
def metrics(shared_server: ServerProcess) -> str:
    """What a server says that has answered something."""
    httpx.post(f"{shared_server.url}/api/v1/locations", json={"name": "door", "interval_s": 60}, trust_env=False)
    posted = {"time": [0, 60], "state": [0, 1]}
    httpx.post(f"{shared_server.url}/api/v1/locations/door/observations", json=posted, trust_env=False)
    return httpx.get(f"{shared_server.url}/metrics", trust_env=False).text


def names(metrics: str) -> set[str]:
    """The names that can be asked for."""
    families = re.findall(r"^# TYPE (\w+) (\w+)", metrics, re.MULTILINE)
    parts = {f"{name}_{part}" for name, kind in families if kind == "histogram" for part in ("bucket", "count", "sum")}
    return parts | {name for name, kind in families if kind != "histogram"}


def expressions() -> Iterator[str]:
    """All that the rules and the dashboard ask."""
    for group in yaml.safe_load(RULES.read_text())["groups"]:
        yield from (rule["expr"] for rule in group["rules"])
    board = json.loads(DASHBOARD.read_text())
    for panel in board["panels"]:
        yield from (target["expr"] for target in panel["targets"])
    yield from (each["query"] for each in board["templating"]["list"])


def test_every_metric_that_is_asked_for_exists(metrics: str) -> None:
    asked = list(expressions())
    assert len(asked) > 30
    for expression in asked:
        assert set(NAME.findall(expression)) <= names(metrics), expression


def test_every_alert_is_explained() -> None:
    for group in yaml.safe_load(RULES.read_text())["groups"]:
        for rule in group["rules"]:
            assert rule["labels"]["severity"] in ("critical", "warning", "info")
            assert rule["annotations"].keys() == {"summary", "description"}, rule["alert"]


def test_the_panels_of_the_dashboard_do_not_overlap() -> None:
    panels = json.loads(DASHBOARD.read_text())["panels"]
    corners = {(panel["gridPos"]["x"], panel["gridPos"]["y"]) for panel in panels}
    assert len(corners) == len(panels) == len({panel["id"] for panel in panels})


@pytest.mark.parametrize(
    "words",
    [
        ("check", "rules", RULES.name),
        ("test", "rules", "tidemap.rules.test.yml"),
        ("check", "config", "--syntax-only", "prometheus.yml"),
    ],
    ids=" ".join,
)
def test_promtool_takes_the_files(words: tuple[str, ...]) -> None:
    done = subprocess.run(
        [program("promtool"), *words], cwd=PROMETHEUS, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_promtool_takes_the_metrics(metrics: str) -> None:
    done = subprocess.run(
        [program("promtool"), "check", "metrics"],
        input=metrics,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/tidemap/bin/tidemap", sys.executable))
    done = subprocess.run(
        [program("systemd-analyze"), "verify", unit], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def test_the_unit_gives_the_server_its_time_to_stop() -> None:
    said = dict(line.split("=", 1) for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#")
    assert int(said["TimeoutStopSec"]) >= 30
    assert said["ExecStart"].split()[1:] == ["serve"]
    assert said["User"] != "root"
