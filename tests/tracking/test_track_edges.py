"""What a scene is made of when footage and annotations are not as they should be."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Silent
from scene4d.core.tracks import Tracks
from scene4d.store import Scene
from scene4d.tracking import TrackOptions, TrackRun, sampling, track_scene
from scene4d.tracking.following import Follower, Look
from scene4d.video.frames import Frame, Source
from walks import CAMERA, FPS, SIZE, car_box, detections, ground, write_video


def boxes_file(tmp_path: Path, rows: list[tuple[int, int]]) -> Path:
    """MOTChallenge rows of (frame from 0, track) at the places of the first person."""
    lines = []
    for frame, track in rows:
        x1, y1, x2, y2 = detections(frame).box_xyxy[0]
        lines.append(f"{frame + 1},{track},{x1},{y1},{x2 - x1},{y2 - y1},1")
    path = tmp_path / "boxes.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_sparsely_annotated_frames_are_all_used(tmp_path, camera):
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(0, 75, 6)])
    options = TrackOptions(camera, annotations=path, fps=25.0)
    track_scene(None, tmp_path / "scene", options, Silent())
    assert Scene.open(tmp_path / "scene").tracks().observed.sum() == 13


def test_some_tracks_missing_means_all_are_tracked_anew(tmp_path, camera):
    path = boxes_file(tmp_path, [(frame, -1 if frame == 30 else 1) for frame in range(60)])
    options = TrackOptions(camera, annotations=path, fps=float(FPS))
    run = track_scene(None, tmp_path / "scene", options, Silent())
    assert run.tracks == {"person": 1}
    assert "tracked anew" in run.warnings[0]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(0, 1), (0, 1)], "boxes.txt: track 1 has 2 boxes in frame 0"),
        ([(0, 3 * 10**9)], "boxes.txt: track 3000000000 is too large"),
    ],
)
def test_impossible_tracks_are_refused_and_nothing_is_left(tmp_path, camera, rows, message):
    options = TrackOptions(camera, annotations=boxes_file(tmp_path, rows), fps=10.0)
    with pytest.raises(InputError, match=message):
        track_scene(None, tmp_path / "scene", options, Silent())
    assert not (tmp_path / "scene").exists()


def test_another_calibration_is_refused_before_anything_is_watched(tmp_path, camera, detector):
    video = write_video(tmp_path / "yard.avi", seconds=2)
    detector()
    track_scene(video, tmp_path / "scene", TrackOptions(camera, name="gate"), Silent())
    other = tmp_path / "other.json"
    CAMERA.disturbed(np.array([0, 0, 0, 0.1, 0.0])).save(other)
    used = detector()
    with pytest.raises(InputError, match="another calibration"):
        track_scene(
            write_video(tmp_path / "b.avi", seconds=2),
            tmp_path / "scene",
            TrackOptions(other, name="gate"),
            Silent(),
        )
    assert used.seen == []


def test_a_camera_that_moves_is_refused_by_a_resumed_run_too(
    tmp_path, camera, detector, monkeypatch
):
    monkeypatch.setattr(sampling, "CHUNK_S", 1.0)
    video = write_video(tmp_path / "yard.avi", shifts=[0] * 35 + [24] * 45)
    for _ in range(3):
        detector()
        with pytest.raises(InputError, match="the camera moves"):
            track_scene(video, tmp_path / "scene", TrackOptions(camera), Silent())


class Live(Source):
    """A stream: frames of the yard without an end."""

    name, image_size, timeline, fps = "rtsp://me:secret@cam/live", SIZE, None, float(FPS)
    warnings = ()

    def frames(self, indices=None):
        for index in range(10**6):
            yield Frame(index, index / FPS, ground())


def test_a_stream_is_watched_until_ctrl_c_and_each_time_is_a_run(
    tmp_path, camera, detector, monkeypatch
):
    monkeypatch.setattr("scene4d.video.reader.open_source", lambda _: Live())
    names = []
    for begin in ("2026-11-20T08:00:00+00:00", "2026-11-20T09:00:00+00:00"):
        detector(until=40)
        options = TrackOptions(camera, start=datetime.fromisoformat(begin))
        run = track_scene(Live.name, tmp_path / "scene", options, Silent())
        assert run.tracks == {"person": 2, "car": 1}
        names.append(run.run)
    assert len(set(names)) == 2
    assert not any("secret" in str(path) for path in tmp_path.rglob("*"))
    scene = Scene.open(tmp_path / "scene")
    assert (len(scene.runs), scene.cameras) == (2, ("live",))
    assert len(np.unique(scene.tracks().track)) == 6


def test_a_moving_car_behind_people_is_not_drawn_towards_them(tmp_path, camera):
    """Half hidden, its lower edge is somebody else's: the position must stay true to its sigma."""
    frames = np.arange(40)
    rows = []
    for frame in frames:
        xy = np.array([-6 + 0.3 * frame, 18.0])
        x1, y1, x2, y2 = car_box(xy)
        low = y1 + 0.6 * (y2 - y1)
        rows.append((frame, "car", (x1, y1, x2, low)))
        rows.append((frame, "person", (x1, low - 30, x2, y2 + 40)))
    found = Detections.from_boxes(
        SIZE,
        np.array([r[0] for r in rows]),
        np.array([r[2] for r in rows]),
        time_s=np.array([r[0] for r in rows]) / FPS,
        track=np.tile([1, 2], len(frames)),
        class_name=np.array([r[1] for r in rows]),
    )
    follower = Follower(Calibration.of_camera(CAMERA), 1.70, TrackRun(tmp_path, "c", "r"))
    parts = [*follower.follow(Look(frames, frames / FPS, found)), follower.finish()]
    tracks = Tracks.concatenate(parts)
    car = tracks.select(tracks.class_name == "car")
    truth = np.column_stack([-6 + 0.3 * car.frame, np.full(len(car), 18.0)])
    error = car.xy_m - truth
    d2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(car.covariance_m2), error)
    assert np.median(d2) < 6
    assert np.median(np.hypot(*error.T)) < 1.5


def test_a_stretch_without_people_is_exported_with_the_others(tmp_path):
    from scene4d.cli.exporting import export_scene
    from scene4d.store.writing import SceneWriter

    def one(track, time_s, name, keypoints):
        square, pair = np.eye(2)[None] * 0.1, np.zeros((1, 2))
        return Tracks(
            track=np.array([track]), class_name=np.array([name]), time_s=np.array([time_s]),
            frame=np.array([int(time_s * 10)]), xy_m=pair + 10, covariance_m2=square,
            shared_covariance_m2=square, velocity_mps=pair, velocity_covariance=square,
            heading_rad=np.zeros(1), heading_sigma_rad=np.ones(1),
            box_xyxy=np.array([[10.0, 10, 50, 90]]), keypoint_uv=np.ones((1, keypoints, 2)),
            keypoint_score=np.ones((1, keypoints)), score=np.ones(1), observed=np.ones(1, bool),
        )  # fmt: skip

    described = CAMERA.to_dict()
    options = {"camera": "c", "start_utc": None, "camera_json": described, "provenance": {}}
    with SceneWriter(tmp_path / "s", run="a", **options) as writer:
        writer.write(one(1, 0.0, "person", 26))
        writer.write(one(2, 700.0, "car", 0))
    with SceneWriter(tmp_path / "s", run="empty", **options):
        pass
    for to in ("csv", "mot", "kpf"):
        export_scene(tmp_path / "s", tmp_path / f"x.{to}", to, run="a")
    assert len((tmp_path / "x.csv").read_text().splitlines()) == 3
    with pytest.raises(InputError, match="run 'empty' is empty"):
        export_scene(tmp_path / "s", tmp_path / "y.csv", "csv", run="empty")


def test_annotations_of_other_footage_are_refused(tmp_path, camera):
    video = write_video(tmp_path / "yard.avi", seconds=1)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    with pytest.raises(InputError, match=r"annotates frame 19 .* has 10 frames"):
        track_scene(video, tmp_path / "scene", TrackOptions(camera, annotations=path), Silent())
    assert not (tmp_path / "scene").exists()


def test_detections_and_annotations_of_one_clip_are_two_runs(tmp_path, camera, detector):
    video = write_video(tmp_path / "yard.avi", seconds=2)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    detector()
    track_scene(video, tmp_path / "scene", TrackOptions(camera), Silent())
    track_scene(video, tmp_path / "scene", TrackOptions(camera, annotations=path), Silent())
    assert [run.rows for run in Scene.open(tmp_path / "scene").runs] == [60, 20]


def test_a_single_picture_is_no_footage(tmp_path, camera):
    import cv2

    cv2.imwrite(str(tmp_path / "photo.png"), ground())
    with pytest.raises(InputError, match="is a single picture"):
        track_scene(tmp_path / "photo.png", tmp_path / "scene", TrackOptions(camera), Silent())
