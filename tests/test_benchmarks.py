"""The comparison with peers measures what it says; no time is asserted, and no peer is needed."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks import ablation, comparison, peers, scenes, search, search_peers
from benchmarks.peers import Method

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.searching import search as search_scene
from scene4d.store.query import Scene

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def street() -> scenes.Scene:
    return scenes.synthetic(1, 0.0, people=60)[0]


def seen_by(camera: Camera | None) -> Method:
    return Method("test", lambda scene: camera)


def test_the_constants_that_the_ablation_changes_exist():
    changed = [constant for variant in ablation.VARIANTS for constant in variant.constants]
    assert len(changed) > 4
    for place, name, value in changed:
        assert type(getattr(place, name)) is type(value)


def test_the_table_of_a_small_run():
    drawn = scenes.synthetic(1, 0.1, people=60)
    attempts = comparison.compare(peers.own_methods(), drawn)
    rows = comparison.table(attempts)
    assert [row[1] for row in rows[1:]] == ["solve_camera", "solve_camera, lens", "SciPy baseline"]
    assert {len(row) for row in rows} == {len(rows[0])}
    for row in rows[1:]:
        told = "given" if row[1].endswith("lens") else "found"
        assert row[:6] == ["10% truncated", row[1], told, "3", "0", "0"]
        assert 0.0 < float(row[6].removesuffix(" m")) < 2.0
    assert rows[1][-1] == "1"


def test_the_true_camera_has_no_error(street: scenes.Scene):
    found = comparison.attempt(seen_by(scenes.CAMERAS[0]), street)
    assert found.error_m == pytest.approx(0, abs=1e-9)
    assert found.focal_error == 0


def test_a_wrong_camera_has_an_error_of_its_own_size(street: scenes.Scene):
    """A camera that is s times as high makes the map s times as large, about its centroid."""
    true = scenes.CAMERAS[0]
    higher = replace(true, t=1.1 * true.t)
    found = comparison.attempt(seen_by(higher), street)
    points = street.error(true).true_xy_m
    size = np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    assert found.error_m == pytest.approx(0.1 * size)
    longer = replace(true, K=true.K * [[1.2, 1, 1], [1, 1.2, 1], [1, 1, 1]])
    found = comparison.attempt(seen_by(longer), street)
    assert found.focal_error == pytest.approx(0.2)
    assert found.error_m is not None
    assert found.error_m > 0.5


def test_nonsense_and_exceptions_are_failures_and_a_refusal_is_not(street: scenes.Scene):
    true = scenes.CAMERAS[0]
    level = Camera.from_pose(
        image_size=true.image_size, focal_px=1500.0, tilt_rad=-0.3, roll_rad=0.0, height_m=6.0
    )

    def raising(scene: scenes.Scene) -> Camera:
        raise RuntimeError("no")

    methods = [
        seen_by(true),
        Method("above the horizon", lambda scene: level),
        Method("far too large", lambda scene: replace(true, t=9 * true.t)),
        Method("raises", raising),
        Method("refuses", lambda scene: None),
    ]
    rows = comparison.table(comparison.compare(methods, [street]))
    assert [row[4:7] for row in rows[1:]] == [
        ["0", "0", "0.00 m"],
        ["0", "1", "> 10 m"],
        ["0", "1", "> 10 m"],
        ["0", "1", "> 10 m"],
        ["1", "0", ""],
    ]


def test_failing_does_not_improve_the_quantiles():
    assert comparison.quantiles([0.1, 0.2, 0.3]) == (0.2, 0.3)
    assert comparison.quantiles([0.1, 0.2, float("inf")]) == (0.2, float("inf"))
    assert comparison.quantiles([0.1, float("inf"), float("inf")])[0] == float("inf")


def test_truncated_people_lose_their_feet_and_nothing_else():
    camera = scenes.CAMERAS[0]
    whole = scenes.draw_people(camera, 200, np.random.default_rng(3))
    cut = scenes.draw_people(camera, 200, np.random.default_rng(3), 0.3)
    np.testing.assert_array_equal(whole[1], cut[1])
    lost = (whole[0] != cut[0]).any(axis=1)
    assert 30 < lost.sum() < 90
    left = np.linalg.norm(cut[0] - cut[1], axis=1) / np.linalg.norm(whole[0] - whole[1], axis=1)
    assert ((left[lost] >= 0.3) & (left[lost] <= 0.85)).all()


@pytest.fixture(scope="module")
def day(tmp_path_factory) -> search.Day:
    return search.write_day(tmp_path_factory.mktemp("day") / "scene", 40_000, 10_000)


def test_the_day_is_what_a_scene_on_the_disk_is(day: search.Day):
    """Rows in the order of tracking, bodies of people alone, a camera that is not exact."""
    scene = Scene.open(day.scene)
    assert len(scene) == day.rows == 49_980
    (run,) = scene.runs
    assert run.keypoints == 26
    seen = scene.tracks()
    people = seen.class_name == "person"
    assert (np.isfinite(seen.keypoint_uv).all(axis=(1, 2)) == people).all()
    assert Calibration.load(scene.camera_file("roof")).covariance is not None
    assert (np.diff(np.asarray(scene.rows(columns=["time_s"])["time_s"].to_numpy())) >= 0).all()


def test_everybody_finds_who_enters(day: search.Day):
    entering = set(day.entering.items())
    assert len(entering) == 2
    scene = Scene.open(day.scene)
    found = search_scene(scene, search.WORDS).events
    roles = [one.event.roles for one in found]
    assert {(role["person"], role["vehicle"]) for role in roles} == entering
    near, *gone = [set(peer(day.scene)) for peer in search_peers.PEERS.values()]
    assert gone == [entering] * 2
    assert near >= entering


def test_a_row_counts_what_is_right():
    one, day = search.Ran(2.0, 3.0, 100.0, ""), search.Day(Path(), 9, {5: 1, 6: 2})
    row = search._row("x", one, search.Ran(4.0, 1.0, 1.0, ""), [(5, 1), (6, 1), (7, 2)], day)
    assert row == ["x", "2.00", "3.00", "100 MB", "0.50", "3", "1 of 2"]


def test_a_command_is_measured_from_outside_and_its_failure_is_one():
    sleeps = [sys.executable, "-c", "import time; time.sleep(0.2); print(7)"]
    found = search.ran(sleeps, 1)
    assert 0.2 < found.seconds < 2.0
    assert found.cpu_s < found.seconds
    assert 5 < found.peak_mb < 40
    assert found.printed == "7\n"
    with pytest.raises(subprocess.CalledProcessError):
        search.ran([sys.executable, "-c", "raise SystemExit(3)"], 1)


def test_a_month_is_a_day_on_every_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(search, "MONTH_DAYS", 2)
    scene = Scene.open(search.write_month(tmp_path / "month", 4_000, 6_000))
    first, second = scene.runs
    assert first.rows == second.rows > 8_000
    assert second.start_ns - first.start_ns == 86_400 * 10**9
    whole = search_scene(scene, search.OF_MONTH[1])
    assert len(whole.runs) == 2
    assert whole.rows == 2 * first.rows


def test_the_page_has_what_the_run_replaces():
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    begun = re.findall(r"<!-- (.*): begin -->", page)
    assert begun == re.findall(r"<!-- (.*): end -->", page)
    assert set(begun) == {
        "machine", "peers", "stages", "start-up", "growth of people", "growth of frames",
        "growth of sizes", "growth of pairs", "search", "growth of search",
        "a month",
    }  # fmt: skip
