"""Where another one was: the same place at another time, in a run, over runs and days."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import finding_scenes as scenes
from scene4d.searching import SearchResult, search
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
