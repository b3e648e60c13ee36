"""One corrupt chunk over HTTP: the rest of the map answers and says what is missing."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text

from tests.api.house import NOW, Api, done, open_house, problem
from tidemap.client import answers
from tidemap.media_types import ARROW
from tidemap.storage.engine import open_writer


@pytest.fixture
def house(tmp_path: Path) -> Iterator[tuple[Api, str]]:
    """A grid of two chunks, the second damaged."""
    with open_house(tmp_path) as api:
        name = api.location(kind="grid2d", grid={"resolution_m": 1, "shape": [40, 40]}, estimator="static")
        seen = [{"time": NOW - 60 * n, "occupied": [0, 1500], "free": [7]} for n in range(3)]
        done(api.post(f"/locations/{name}/observations", {"observations": seen}), 201)
        api.update(name)
        engine = open_writer(api.ctx.settings.url)
        with engine.begin() as connection:
            connection.execute(text("UPDATE spectrum SET payload = substr(payload, 1, 40) WHERE chunk = 1"))
        engine.dispose()
        yield api, name


def test_the_map_answers_and_says_what_is_missing(house: tuple[Api, str], caplog: pytest.LogCaptureFixture) -> None:
    api, name = house
    answer = api.get(f"/locations/{name}/state")
    said = done(answer)
    assert (said["cell"], said["unavailable"]) == ([0, 7], [[1024, 1600]])
    asked = api.post(f"/locations/{name}/predict", {"time": [NOW]})
    predicted = done(asked)
    assert predicted["unavailable"] == answers.prediction(asked.content).unavailable.tolist() == [[1024, 1600]]
    assert [predicted["probability"][cell][0] is None for cell in (0, 7, 1500)] == [False, False, True]
    dense = np.load(io.BytesIO(api.get(f"/locations/{name}/state", headers={"Accept": "application/x-npy"}).content))
    assert np.count_nonzero(~np.isnan(dense)) == 2
    table = api.get(f"/locations/{name}/state", headers={"Accept": ARROW}).content
    assert answers.state(table, ARROW).unavailable.tolist() == [[1024, 1600]]
    assert sum("chunk 1 is corrupt" in record.message for record in caplog.records) == 1
    assert "tidemap_damaged_blobs 1.0" in api.http.request("GET", "/metrics").text.splitlines()
    api.update(name)
    repaired = api.get(f"/locations/{name}/state")
    assert done(repaired)["unavailable"] == []
    assert repaired.headers["etag"] != answer.headers["etag"]


def test_a_question_about_a_cell_in_it_is_a_problem_of_its_own(house: tuple[Api, str]) -> None:
    api, name = house
    asked = [
        api.post(f"/locations/{name}/predict", {"time": [NOW], "cell": [0, 1500]}),
        api.get(f"/locations/{name}/series?cell=1500"),
        api.get(f"/locations/{name}/model?cell=1500"),
    ]
    for answer in asked:
        found = problem(answer, 500, "corrupt-chunk")
        assert f"spectrum of location '{name}', chunk 1 is corrupt" in found["detail"]
        assert "backup" in found["detail"]
    done(api.get(f"/locations/{name}/model?cell=7"))
    done(api.post(f"/locations/{name}/observations", {"observations": [{"time": NOW, "occupied": [1500]}]}), 201)
