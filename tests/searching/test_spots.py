"""Where another one was: the same place at another time, in a run, over runs and days."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import finding_scenes as scenes
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.searching import SearchOptions, SearchResult, _entry, search
from scene4d.searching.standing import StandingSearches
from scene4d.store.query import Scene

MORNING = datetime(2026, 11, 20, 8, 0, 0, tzinfo=UTC)
STOOD = "a person stops within 2 m of where another person stood"


def standing(number: int, at, begin_s: float, seconds: float = 5.0, kind: str = "person"):
    """Somebody who walks up, stands, and walks on."""
    x, y = at
    way = [scenes.walk((x - 4, y), at, 3), scenes.stay(at, seconds), scenes.walk(at, (x + 4, y), 3)]
    return scenes.track(number, np.vstack(way), begin_s, kind)


@pytest.fixture(scope="module")
def days(tmp_path_factory) -> Scene:
    """On the first day somebody stands at (0, 14) and a car is parked at (-3, 20); on the second
    one person stops at (0.5, 14), another at (0, 22).
    """
    folder = tmp_path_factory.mktemp("days") / "scene"
    car = scenes.track(9, scenes.stay((-3, 20), 20), kind="car")
    scenes.write_scene(folder, [standing(1, (0, 14), 2.0), car], run="one", start=MORNING)
    scenes.write_scene(
        folder,
        [standing(1, (0.5, 14), 2.0), standing(2, (0, 22), 14.0), standing(3, (0.2, 14), 20.0)],
        run="two",
        start=MORNING + timedelta(days=1),
    )
    return Scene.open(folder)


def found(scene: Scene, words: str) -> list[tuple[str, float, dict]]:
    """Run and time of each event, and its spot."""
    done: SearchResult = search(scene, words, min_score=0.2)
    events = sorted((one.to_dict() for one in done.events), key=lambda e: (e["run"], e["begin_s"]))
    return [(e["run"], e["begin_s"], e["spots"][0]) for e in events]


def test_over_days_and_the_nearest_that_fits(days):
    first, again = found(days, STOOD)
    assert (first[0], again[0]) == ("two", "two")
    assert first[1] == pytest.approx(2, abs=1.5)
    assert again[1] == pytest.approx(20, abs=1.5)
    spot = first[2]
    assert (spot["run"], spot["camera"]) == ("one", "gate")
    assert (spot["x_m"], spot["y_m"]) == pytest.approx((0, 14), abs=0.2)
    assert spot["begin_time"].startswith("2026-11-20T08:00:0")
    assert spot["distance_m"] == pytest.approx(0.5, abs=0.3)
    # Of who stood at (0, 14) and at (0.5, 14) the nearer one to (0.2, 14) counts.
    assert again[2]["run"] == "one"
    (yesterday, later) = found(days, f"{STOOD} yesterday")
    assert {yesterday[2]["run"], later[2]["run"]} == {"one"}
    ((run, begin_s, spot),) = found(days, f"{STOOD} today")
    assert (run, spot["run"]) == ("two", "two")
    assert begin_s == pytest.approx(20, abs=1.5)


def test_one_state_or_another_at_a_time_of_day_earlier_and_later(days):
    place = "a person stands within 3 m of where a vehicle was parked"
    assert found(days, place) == []  # nobody came so near
    near_car = "a person stands within 8 m of where a vehicle was parked"
    runs = {(run, spot["run"]) for run, _, spot in found(days, near_car)}
    assert runs == {("two", "one")}
    # On the first day somebody stands by the car while it is there.
    assert [run for run, _, _ in found(days, f"{near_car} today")] == ["one"]
    assert found(days, f"{near_car} between 9 am and 10 am") == []
    runs = [run for run, _, _ in found(days, f"{near_car} between 8 am and 9 am")]
    assert runs == ["one", "two", "two", "two"]
    assert found(days, f"{near_car} more than 2 days ago") == []
    (seen, *_) = found(days, "a person stands within 1 m of where another person will stand")
    assert (seen[0], seen[2]["run"]) == ("one", "two")


def test_each_run_is_read_once_whichever_way_the_words_look(days, monkeypatch):
    read: list[str] = []
    whole = _entry.staged_run

    def reading(asked, run, *more):
        read.append(run.run)
        return whole(asked, run, *more)

    monkeypatch.setattr(_entry, "staged_run", reading)
    names = [run.run for run in days.runs]
    for words in (STOOD, f"{STOOD} yesterday"):
        assert [run.run for run in search(days, words).runs] == names
        assert read == names
        read.clear()
    search(days, "a person stands where another person will stand")
    assert read == names[::-1]


def test_the_event_says_who_was_where_and_when_and_the_page_shows_it(days, tmp_path):
    done = search(days, f"{STOOD} yesterday", min_score=0.2)
    (note,) = done.events[0].about_spots
    assert "track 1 of camera gate, run one, from 2026-11-20 08:00:0" in note
    assert note in done.events[0].to_dict()["notes"]
    assert "another person stood yesterday: stationary(person)" in done.to_dict()["predicates"]
    page = done.save(tmp_path).read_text()
    assert note.replace("'", "&#39;") in page
    assert "spot &#34;another person stood yesterday&#34;: another one, the day before" in page
    assert "<title>" in page and 'stroke-dasharray="2 3"' in page


def test_without_a_start_a_clip_is_compared_with_itself(tmp_path):
    for run in ("one", "two"):
        people = [standing(1, (0, 14), 0.0), standing(2, (0.3, 14), 12.0)]
        scenes.write_scene(tmp_path / "s", people, run=run)
    scene = Scene.open(tmp_path / "s")
    done = search(scene, STOOD, min_score=0.2)
    assert [one.event.begin_s > 10 for one in done.events] == [True, True]
    assert all(one.spots[0].run.run == one.run.run for one in done.events)
    assert any("is not known" in note for note in done.asked.notes)
    with pytest.raises(InputError, match="the start of the footage is unknown"):
        search(scene, f"{STOOD} yesterday")
    with pytest.raises(InputError, match="nobody can be the 'vehicle'"):
        search(scene, "a person stops where a vehicle was parked")


def test_what_is_watched_does_not_remember(days, tmp_path):
    calibration = Calibration.load(days.camera_file("gate"))
    with pytest.raises(InputError, match="not remembered while watching"):
        StandingSearches((STOOD,), SearchOptions(), "gate", calibration, tmp_path)
