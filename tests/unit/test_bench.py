"""The bench: its figures run, on sizes that take seconds, and their lines say what they measured."""

import json
from typing import Any

import pytest

from tests.bench import __main__ as bench
from tests.bench import databases, observing
from tests.bench.figures import million, observed, year_update
from tests.bench.timing import Figure, quantile


def line(figure: Figure) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(figure.line()))
    assert found["value"] > 0
    assert found["floor"] > 0
    return found


@pytest.mark.slow
def test_an_observation_is_measured_beside_its_bytes() -> None:
    found = line(observing.figure(databases.sqlite, databases.raw_sqlite, rounds=1))
    assert found["cells"] == 10_000
    assert found["packed_bytes"] < found["body_bytes"]


@pytest.mark.slow
def test_a_large_map_is_made_updated_and_loaded() -> None:
    found = line(million.measure((16, 16, 8)))
    assert found["cells"] == 2048
    assert found["estimator"] in ("calendar", "fft", "static")


@pytest.mark.slow
def test_what_was_last_seen_is_measured_beside_the_state() -> None:
    found = line(observed.measure((16, 16, 8)))
    assert found["cells"] == 2048
    assert min(found["post_ms"], found["next_ms"], found["rhythm_floor_ms"]) > 0


@pytest.mark.slow
def test_a_year_is_updated_by_a_server() -> None:
    found = line(year_update.measure((16, 8, 8)))
    assert (found["state"], found["cells"], found["samples"]) == ("done", 1024, 105_120)


def test_every_figure_says_what_it_is_and_measures_it() -> None:
    for path in bench.FOLDER.glob("*.py"):
        text = path.read_text()
        assert text.startswith(f'"""{path.stem}: '), path.name
        assert "def measure(" in text, path.name


def test_an_unknown_figure_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench.main(["nonsense"]) == 2
    assert "unknown figure nonsense; known are building, calendar" in capsys.readouterr().err


@pytest.mark.parametrize(("share", "expected"), [(0.0, 1.0), (0.5, 3.0), (0.99, 5.0), (1.0, 5.0)])
def test_a_quantile_is_one_of_the_values(share: float, expected: float) -> None:
    assert quantile([5.0, 1.0, 3.0, 4.0, 2.0], share) == expected
