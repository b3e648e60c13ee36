"""Maps of the simulated laboratory, made by the service of scans whose poses are wrong; the chances are new to it."""

import pytest

from docs.paper.lab_scores import against_truth, known_cells
from docs.paper.lab_week import START, SURVEY_S, LabWeek, lab_week
from tidemap.demo.areas import AREAS

SEED, EVERY_S = 77, 2400.0


@pytest.fixture(scope="module", params=[AREAS[0], AREAS[2]], ids=lambda area: area.name)
def day(request: pytest.FixtureRequest) -> LabWeek:
    """A day and a quarter, so that later scans are registered by what the first day taught."""
    return lab_week(request.param, SEED, 1.25, EVERY_S)


@pytest.mark.parametrize("name", ["2D", "3D"])
def test_maps_of_registered_scans_are_as_right_as_those_from_true_poses(day: LabWeek, name: str) -> None:
    maps = day.maps[name]
    cells = known_cells(maps)
    true, registered, stated = (
        against_truth(maps, poses, day.stop, cells) for poses in ("true", "registered", "stated")
    )
    assert len(cells) > (15_000 if name == "3D" else 800)
    assert true > 0.92
    assert abs(true - registered) < 0.02
    assert registered > stated + 0.02


@pytest.mark.parametrize("name", ["2D", "3D"])
def test_what_is_accepted_is_right(day: LabWeek, name: str) -> None:
    posted = [each for each in day.maps[name].posted if each.time >= START + SURVEY_S]
    accepted = [each for each in posted if each.verdict == "accepted"]
    assert len(accepted) > 0.9 * len(posted) > 30
    assert not any(each.standing.wrong for each in accepted)
    assert any(each.stated.wrong for each in accepted)
