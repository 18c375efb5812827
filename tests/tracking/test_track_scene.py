"""``track``: from footage or annotations to a scene on disk, killed and resumed."""

import json
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.store.query import Scene
from scene4d.tracking import TrackOptions, track, watching
from scene4d.tracking import _running as running
from scene4d.tracking.placing import bottoms_hidden
from walks import (
    CAMERA,
    CAR,
    FPS,
    SECONDS,
    SIZE,
    detections,
    ground,
    mot_text,
    places,
    write_video,
)


def tracked(scene: Path) -> Tracks:
    return Scene.open(scene).tracks()


def assert_true(tracks: Tracks, *, people: int = 2, within_m: float = 0.25) -> None:
    """Every person is one track, near the true place and speed at every moment."""
    found = np.unique(tracks.track[tracks.class_name == "person"])
    assert len(found) == people
    for name in found:
        one = tracks.select(tracks.track == name)
        truth = np.array([places(t) for t in one.time_s])
        off = np.linalg.norm(one.xy_m[:, None] - truth, axis=2)
        who = int(off.mean(axis=0).argmin())
        assert off[:, who].max() < within_m
        middle = slice(10, -10)
        speed = np.linalg.norm(one.velocity_mps[middle], axis=1)
        expected = np.linalg.norm((truth[-1, who] - truth[0, who]) / np.ptp(one.time_s))
        np.testing.assert_allclose(speed, expected, rtol=0.2)
        assert (one.z_m == 0).all() and (np.abs(one.size_m[:, 2] - 1.70) < 0.06).all()
        assert np.isfinite(one.heading_rad[middle]).all()


@pytest.mark.parametrize("tracks", [True, False])
def test_annotated_boxes_become_a_scene(tmp_path, camera, tracks):
    boxes = tmp_path / "boxes.txt"
    boxes.write_text(mot_text(tracks=tracks))
    options = TrackOptions(annotations=boxes, fps=float(FPS), name="yard")
    run = track(None, camera, tmp_path / "scene", options)
    assert run.tracks == {"person": 2}
    assert run.rows == 2 * FPS * SECONDS
    found = tracked(tmp_path / "scene")
    assert_true(found)
    if tracks:
        assert set(found.track % 1_000_000_000) == {1, 2}
    assert Scene.open(tmp_path / "scene").cameras == ("yard",)


def test_the_rate_thins_annotated_frames(tmp_path, camera):
    boxes = tmp_path / "boxes.txt"
    boxes.write_text(mot_text(tracks=True))
    options = TrackOptions(annotations=boxes, fps=float(FPS), rate_hz=2.0)
    run = track(None, camera, tmp_path / "scene", options)
    assert run.rows == 2 * 2 * SECONDS
    assert len(np.unique(tracked(tmp_path / "scene").time_s)) == 2 * SECONDS


def test_a_video_becomes_a_scene_with_a_parked_car(tmp_path, camera, detector, drawn):
    used = detector()
    video = write_video(tmp_path / "yard.avi")
    run = track(video, camera, tmp_path / "scene")
    assert used.seen == list(range(FPS * SECONDS))
    assert run.tracks == {"person": 2, "car": 1}
    found = tracked(tmp_path / "scene")
    assert_true(found)
    car = found.select(found.class_name == "car")
    assert np.linalg.norm(car.xy_m - CAR, axis=1).max() < 0.8
    assert car.xy_m.std(axis=0).max() < 0.05
    assert "was not checked" in run.warnings[0]
    assert run.objects_picture.stat().st_size > 10_000
    for size_m, sigma_m, is_m in zip(
        car.size_m[-1], car.size_sigma_m[-1], (4.4, 1.8, 1.5), strict=True
    ):
        assert abs(size_m - is_m) < 2 * sigma_m


def columns(scene: Path) -> dict[str, list]:
    (file,) = scene.glob("tracks/camera=*/day=*/*.parquet")
    return pq.ParquetFile(file).read().to_pydict()


def test_a_killed_run_goes_on_and_ends_the_same(tmp_path, camera, detector, monkeypatch):
    monkeypatch.setattr(watching, "_CHUNK_S", 2.0)
    video = write_video(tmp_path / "yard.avi")
    detector()
    track(video, camera, tmp_path / "whole")
    for until in (5, 33, 55):
        killed = detector(until)
        with pytest.raises(KeyboardInterrupt):
            track(video, camera, tmp_path / "again")
        assert not list((tmp_path / "again").rglob("*.parquet"))
    assert killed.seen[0] == 20, "what was seen before 2 s is not seen again"
    last = detector()
    run = track(video, camera, tmp_path / "again")
    assert (run.resumed, last.seen[0]) == (2, 40)
    assert columns(tmp_path / "again") == columns(tmp_path / "whole")
    # Once more: nothing is detected again, and nothing is there twice.
    idle = detector()
    track(video, camera, tmp_path / "again")
    assert idle.seen == []
    assert columns(tmp_path / "again") == columns(tmp_path / "whole")


def test_a_second_run_adds_to_the_scene(tmp_path, camera, detector):
    detector()
    for name in ("a.avi", "b.avi"):
        track(
            write_video(tmp_path / name, seconds=3),
            camera,
            tmp_path / "scene",
            TrackOptions(name="gate"),
        )
    scene = Scene.open(tmp_path / "scene")
    assert len(scene.runs) == 2
    assert len(np.unique(scene.tracks().track)) == 6


@pytest.mark.parametrize(("shift", "moved"), [(0, False), (24, True)])
def test_a_camera_that_moved_since_it_was_calibrated_is_refused(
    tmp_path, camera, detector, shift, moved
):
    cv2.imwrite(str(camera.with_name("background.jpg")), ground(shift))
    detector()
    video = write_video(tmp_path / "yard.avi")
    if moved:
        with pytest.raises(InputError, match=r"has moved by 2\d px since the camera was calib"):
            track(video, camera, tmp_path / "scene")
        assert not list((tmp_path / "scene").rglob("*.parquet"))
    else:
        assert not track(video, camera, tmp_path / "scene").warnings


def test_footage_of_another_size_is_refused(tmp_path, camera, detector):
    detector()
    video = write_video(tmp_path / "small.avi", seconds=1, size=(320, 240))
    with pytest.raises(InputError, match="is 320x240, but the camera was calibrated on 640x480"):
        track(video, camera, tmp_path / "scene")


def test_annotations_without_a_clock_are_refused(tmp_path, camera):
    boxes = tmp_path / "boxes.txt"
    boxes.write_text(mot_text(tracks=True))
    with pytest.raises(InputError, match=r"boxes.txt: frames need times: give the footage, or fps"):
        track(None, camera, tmp_path / "scene", TrackOptions(annotations=boxes))


@pytest.mark.parametrize(
    ("changed", "message"),
    [({"rate_hz": 0.0}, "rate"), ({"fps": -1.0}, "fps"), ({"person_height_m": 9.0}, "person_h")],
)
def test_impossible_options_are_refused(changed, message):
    with pytest.raises(InputError, match=message):
        TrackOptions(**changed)


def test_a_lens_is_no_camera(tmp_path):
    lens = tmp_path / "lens.json"
    lens.write_text(json.dumps({"K": CAMERA.K.tolist(), "image_size": list(SIZE)}))
    with pytest.raises(InputError, match=r"lens.json"):
        track(tmp_path / "x.avi", lens, tmp_path / "scene")


def test_what_stands_before_a_car_hides_its_wheels():
    found = detections(0)
    boxes = np.array([[100, 100, 200, 200], [150, 120, 210, 260], [300, 100, 400, 200.0]])
    found = type(found).from_boxes(SIZE, np.array([0, 0, 1]), boxes)
    assert bottoms_hidden(found).tolist() == [True, False, False]
    apart = type(found).from_boxes(SIZE, np.array([0, 1, 2]), boxes)
    assert not bottoms_hidden(apart).any(), "other frames hide nothing"


def test_the_picture_of_a_long_run_stays_small(tmp_path, camera, monkeypatch, drawn):
    monkeypatch.setattr(running, "_MOST_DRAWN", 60)
    boxes = tmp_path / "boxes.txt"
    boxes.write_text(mot_text(tracks=True))
    options = TrackOptions(annotations=boxes, fps=float(FPS))
    shown = []
    draw = running._drawn
    monkeypatch.setattr(
        running, "_drawn", lambda job, paths: shown.append(paths) or draw(job, paths)
    )
    run = track(None, camera, tmp_path / "scene", options)
    assert run.picture.stat().st_size > 10_000
    assert run.objects_picture is None, "there is no footage"
    assert 20 < sum(len(xy) for _, xy in shown[0].values()) <= 62 < run.rows
