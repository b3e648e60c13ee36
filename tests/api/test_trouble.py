"""When the server cannot: busy, stopping, its database spoilt. It says so, and what to do, and goes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest
from sqlalchemy import text

from tests.api.house import NOW, Api, done, fortnight, open_house, problem
from tests.support.waiting import WAIT_S
from tidemap.storage.engine import open_writer


@contextmanager
def occupied_writer(api: Api) -> Iterator[None]:
    """Within, the writer writes nothing and its queue is full."""
    begun, go_on = Event(), Event()

    def wait(_: object) -> None:
        begun.set()
        go_on.wait(WAIT_S)

    api.ctx.store.submit(wait)
    assert begun.wait(WAIT_S)
    waiting = [api.ctx.store.submit(lambda _: None) for _ in range(api.ctx.settings.commit_queue)]
    try:
        yield
    finally:
        go_on.set()
        for future in waiting:
            future.result(WAIT_S)


def execute(api: Api, statement: str) -> None:
    """Do something to the database behind the server's back."""
    engine = open_writer(api.ctx.settings.url)
    with engine.begin() as connection:
        connection.execute(text(statement))
    engine.dispose()


def test_a_full_queue_refuses_writes_and_says_when_to_try_again(tmp_path: Path) -> None:
    with open_house(tmp_path, commit_queue=2) as api:
        name = api.location()
        form = {"time": [NOW], "state": [1]}
        writes = [
            ("POST", f"/locations/{name}/observations", form),
            ("POST", "/locations", {"name": "other", "interval_s": 60}),
            ("PATCH", f"/locations/{name}", {"confidence": 0.7}),
            ("DELETE", f"/locations/{name}", None),
            ("POST", f"/locations/{name}/update", {}),
            ("POST", "/keys", {"name": "r", "role": "robot"}),
        ]
        before = api.everything()
        with occupied_writer(api):
            for method, path, body in writes:
                answer = api.request(method, path, **({"json": body} if body else {}))
                found = problem(answer, 503, "queue-full")
                assert answer.headers["retry-after"] == "1"
                assert "nothing was stored" in found["detail"]
            assert api.facts(name)["observations"] == 0, "reading goes on"
        assert api.everything() == before
        done(api.post(f"/locations/{name}/observations", form), 201)


def test_while_stopping_writes_are_refused(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        name = api.location()
        api.ctx.store.close()
        answer = api.post(f"/locations/{name}/observations", {"time": [NOW], "state": [1]})
        problem(answer, 503, "shutting-down")
        assert int(answer.headers["retry-after"]) >= 1


@pytest.mark.parametrize("table", ["observation", "location"])
def test_a_database_that_fails_is_no_internal_error(tmp_path: Path, table: str) -> None:
    with open_house(tmp_path) as api:
        name = api.location()
        execute(api, f"ALTER TABLE {table} RENAME TO gone")
        form = {"time": [NOW], "state": [1]}
        answer = api.post(f"/locations/{name}/observations", form, headers={"Idempotency-Key": "k"})
        problem(answer, 503, "storage-unavailable")
        assert answer.headers["retry-after"]
        execute(api, f"ALTER TABLE gone RENAME TO {table}")
        done(api.post(f"/locations/{name}/observations", form, headers={"Idempotency-Key": "k"}), 201)


def test_a_damaged_spectrum_is_named_and_nothing_else_suffers(tmp_path: Path) -> None:
    with open_house(tmp_path) as api:
        broken, whole = api.location(estimator="fft", order=2), api.location(estimator="fft", order=2)
        for name in (broken, whole):
            api.observe(name, *fortnight())
            api.update(name)
        execute(
            api,
            "UPDATE spectrum SET payload = substr(payload, 1, 40) WHERE location_id = "
            f"(SELECT id FROM location WHERE name = '{broken}')",
        )
        answer = api.get(f"/locations/{broken}/state")
        found = problem(answer, 500, "corrupt-chunk")
        assert broken in found["detail"]
        assert "chunk 0" in found["detail"]
        done(api.get(f"/locations/{whole}/state"))
        done(api.get("/locations"))
        api.update(broken)
        done(api.get(f"/locations/{broken}/state"))


def test_an_error_that_nobody_foresaw_shows_nothing_of_the_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the secret is in /etc/tidemap")

    with open_house(tmp_path) as api:
        monkeypatch.setattr("tidemap.api.routers.locations.locations.get_location", fail)
        answer = api.get("/locations/door")
        found = problem(answer, 500)
        assert "secret" not in answer.text
        assert "log" in found["detail"]
        assert done(api.get("/jobs"))["items"] == []
