"""DELETE /locations/{name}/observations: a wrong clock, from the post to the map without it."""

from pathlib import Path

import numpy as np

from tests.api.house import DAY, HOUR, NOW, Api, done, fortnight, open_house, problem


def test_a_wrong_clock_spoils_nothing_and_its_reading_goes(tmp_path: Path) -> None:
    with open_house(tmp_path, past_s=1e11) as api:
        name = api.location(interval_s=600, estimator="fft", order=2)
        time = np.arange(NOW - 28 * DAY, NOW, 600.0)
        hour = time % DAY // HOUR
        api.observe(name, time, ((hour >= 8) & (hour < 18)).astype(int), params={"source": "spot"})
        api.observe(name, [37], [1], params={"source": "rover"})
        assert api.facts(name)["first_time"] == "1970-01-01T00:00:37Z"
        series = done(api.get(f"/locations/{name}/series"))
        assert sum(each is not None for each in series["observed"]) == len(time)
        api.update(name)
        model = done(api.get(f"/locations/{name}/model"))
        assert model["samples"] == len(time)
        assert {round(each["period_s"] / HOUR) for each in model["components"]} == {24, 12}
        path = f"/locations/{name}/observations?start=0&stop=1970-01-02T00:00:00Z&source="
        assert done(api.delete(path + "spot")) == {"deleted": 0}
        assert done(api.delete(path + "rover")) == {"deleted": 1}
        facts = api.facts(name)
        assert (facts["observations"], facts["first_time"]) == (len(time), "2026-02-02T00:00:00Z")
        assert done(api.delete(path + "rover")) == {"deleted": 0}


def test_a_source_that_cannot_be_told_apart_is_refused_with_words(api: Api) -> None:
    name = api.location(estimator="static")
    for source in ("spot", "rover"):
        api.observe(name, *fortnight(), params={"source": source})
    api.update(name)
    path = f"/locations/{name}/observations?start={NOW - DAY}&stop={NOW}"
    found = problem(api.delete(path + "&source=spot"), 422)
    assert found["errors"][0]["field"] == "source"
    assert "measured by 'rover'" in found["detail"]
    assert api.facts(name)["observations"] == 2 * 14 * 24
    assert done(api.delete(path)) == {"deleted": 24}


def test_retention_drops_and_tells(api: Api) -> None:
    name = api.location(retention=DAY)
    answer = api.observe(name, [NOW - 2 * DAY, NOW - HOUR], [1, 1])
    assert (answer["accepted"], answer["dropped"], answer["first_time"]) == (1, 1, "2026-03-01T23:00:00Z")
    answer = api.observe(name, [NOW - 2 * DAY], [1])
    assert (answer["accepted"], answer["dropped"], answer["first_time"]) == (0, 1, None)
    assert api.facts(name)["first_time"] == "2026-03-01T23:00:00Z"
    api.clock.now = NOW + 2 * DAY
    assert api.facts(name)["observations"] == 1


def test_combine_is_a_setting_of_a_location(api: Api) -> None:
    name = api.location(combine="majority")
    assert api.facts(name)["combine"] == "majority"
    assert done(api.patch(f"/locations/{name}", {"combine": "any"}))["combine"] == "any"
    api.observe(name, [NOW - HOUR, NOW - HOUR + 10], [1, 0])
    found = problem(api.patch(f"/locations/{name}", {"combine": "latest"}), 422)
    assert found["errors"][0]["field"] == "combine"
    problem(api.patch(f"/locations/{name}", {"combine": "most"}), 422)
    observed = done(api.get(f"/locations/{name}/series"))["observed"]
    assert observed == [1]
