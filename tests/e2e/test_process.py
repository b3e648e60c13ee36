"""`tidemap serve` as a process: it starts, stops and comes back."""

from pathlib import Path

import httpx

from tests.support.server import ServerProcess, StartServer, fresh, run_command
from tidemap.version import __version__

DOOR = {"name": "door", "kind": "state", "interval_s": 60}
SEEN = {"time": [0, 60, 120], "state": [0, 1, 0]}


def test_it_stops_cleanly(server: StartServer) -> None:
    started = server(launch=fresh)
    assert started.stop() == 0
    begun, *_, ended = (line for line in started.output().splitlines() if " tidemap.server.serving: " in line)
    assert f"Tidemap {__version__} on sqlite:///{started.data}/tidemap.db" in begun
    assert "everybody on this machine is an admin" in begun
    assert "stops" in ended
    assert [path.name for path in started.data.iterdir()] == ["tidemap.db"]


def test_what_it_acknowledged_survives_its_death(server: StartServer) -> None:
    started = server(launch=fresh)
    post(started, "/locations", DOOR)
    post(started, "/locations/door/observations", SEEN)
    started.kill()
    started.restart()
    assert httpx.get(f"{started.url}/api/v1/locations/door").json()["observations"] == 3


def test_beyond_loopback_it_wants_a_key(tmp_path: Path) -> None:
    refused = run_command("serve", "--host", "0.0.0.0", "--port", "0", "--data", str(tmp_path))
    assert refused.returncode == 1
    assert "tidemap keys create" in refused.stderr


def post(server: ServerProcess, path: str, form: object) -> None:
    httpx.post(f"{server.url}/api/v1{path}", json=form).raise_for_status()
