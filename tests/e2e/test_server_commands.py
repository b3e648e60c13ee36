"""`tidemap locations`, `anomalies` and `update`: what people ask a running server from a shell."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from tests.support.here import Done, command
from tests.support.server import ServerProcess
from tests.support.site import Site
from tidemap.client import RetryPolicy


@pytest.fixture(scope="module")
def site(shared_server: ServerProcess) -> Iterator[Site]:
    with Site(shared_server) as made:
        yield made


def ask(site: Site, *words: str) -> Done:
    return command(*words, "--url", site.server.url)


def asked(site: Site, *words: str) -> Any:
    """The JSON that a command prints."""
    done = ask(site, *words, "--json")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return json.loads(done.stdout)


def test_locations_are_listed_shown_renamed_and_deleted(site: Site) -> None:
    room, other = site.empty_room(), site.empty_room()
    assert {each["name"] for each in asked(site, "locations", "list")} >= {room, other}
    lines = ask(site, "locations", "list").stdout.splitlines()
    assert f"{room}\tstate\trevision 1\t20 measurements\t0 open anomalies" in lines
    assert asked(site, "locations", "show", room)["interval_s"] == 1
    assert f"name\t{room}" in ask(site, "locations", "show", room).stdout
    assert asked(site, "locations", "rename", room, "renamed")["name"] == "renamed"
    taken = ask(site, "locations", "rename", "renamed", other)
    assert (taken.returncode, taken.stdout) == (1, "")
    assert "exists already" in taken.stderr
    assert ask(site, "locations", "delete", "renamed", "--yes").stdout == "renamed is deleted.\n"
    gone = ask(site, "locations", "show", "renamed")
    assert gone.returncode == 1
    assert "There is no location 'renamed'" in gone.stderr
    assert asked(site, "locations", "delete", other, "--yes") == {"deleted": other}


def test_anomalies_are_listed(site: Site) -> None:
    room = site.empty_room()
    ids = [site.observe(room, [moment], [1])["anomalies"][0]["id"] for moment in range(1000, 1500, 100)]
    listed = asked(site, "anomalies", "--location", room)
    assert [each["id"] for each in listed] == ids
    assert [each["id"] for each in asked(site, "anomalies", "--after", str(ids[0]), "--limit", "2")] == ids[1:3]
    between = asked(site, "anomalies", "--location", room, "--start", "1970-01-01T00:18:20Z", "--stop", "1250")
    assert [each["id"] for each in between] == ids[1:3]
    site.http.post(f"/anomalies/{ids[0]}/acknowledge")
    assert [each["id"] for each in asked(site, "anomalies", "--location", room, "--open")] == ids[1:]
    (line,) = ask(site, "anomalies", "--location", room, "--limit", "1").stdout.splitlines()
    assert line.split("\t")[:4] == [str(ids[0]), room, "1970-01-01T00:16:40Z", "1970-01-01T00:16:41Z"]


def test_a_location_is_updated(site: Site) -> None:
    room = site.empty_room()
    done = ask(site, "update", room)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith(": done\n")
    assert asked(site, "update", room)["state"] == "done"
    empty = site.http.post("/locations", json={"name": "never-seen", "interval_s": 1})
    assert empty.status_code == 201
    failed = ask(site, "update", "never-seen")
    assert failed.returncode == 1
    assert ": failed (" in failed.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("locations", "list"),
        ("anomalies",),
        ("update", "door"),
        ("export", "door", "--format", "ply"),
        ("demo", "--no-live"),
    ],
    ids=" ".join,
)
def test_a_server_that_is_not_there_is_named(words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    once = RetryPolicy(tries=1)
    monkeypatch.setattr("tidemap.client.blocking.RetryPolicy", lambda: once)
    done = command(*words, "--url", "http://127.0.0.1:9")
    assert (done.returncode, done.stdout) == (1, "")
    assert "127.0.0.1:9" in done.stderr


def test_a_wrong_address_or_key_is_said(site: Site) -> None:
    done = command("locations", "list", "--url", "127.0.0.1:8000")
    assert done.returncode == 2
    assert "http://" in done.stderr
    refused = ask(site, "locations", "list", "--key", "tm_wrong")
    assert refused.returncode == 1
    assert "tm_wrong" not in refused.stderr
    assert "401" in refused.stderr
