"""What a scene is made of when footage and annotations are not as they should be."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from scene4d.core.body import HALPE26
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Tracks
from scene4d.store import Scene
from scene4d.store.footage import footage_of
from scene4d.store.log import Look
from scene4d.tracking import TrackOptions, track, watching
from scene4d.tracking.annotated import looks_of
from scene4d.tracking.following import follow
from scene4d.video.frames import Frame, Source
from walks import (
    CAMERA,
    CAR,
    FPS,
    SIZE,
    car_box,
    detections,
    ground,
    person_box,
    places,
    write_video,
)


def boxes_file(tmp_path: Path, rows: list[tuple[int, int]]) -> Path:
    """MOTChallenge rows of (frame from 0, track) at the places of the first person."""
    lines = []
    for frame, number in rows:
        x1, y1, x2, y2 = detections(min(frame, 100)).box_xyxy[0]
        lines.append(f"{frame + 1},{number},{x1},{y1},{x2 - x1},{y2 - y1},1")
    path = tmp_path / "boxes.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_sparsely_annotated_frames_are_all_used(tmp_path, camera):
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(0, 75, 6)])
    options = TrackOptions(annotations=path, fps=25.0)
    track(None, camera, tmp_path / "scene", options)
    assert Scene.open(tmp_path / "scene").tracks().observed.sum() == 13


def test_some_tracks_missing_means_all_are_tracked_anew(tmp_path, camera):
    path = boxes_file(tmp_path, [(frame, -1 if frame == 30 else 1) for frame in range(60)])
    options = TrackOptions(annotations=path, fps=float(FPS))
    run = track(None, camera, tmp_path / "scene", options)
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
    options = TrackOptions(annotations=boxes_file(tmp_path, rows), fps=10.0)
    with pytest.raises(InputError, match=message):
        track(None, camera, tmp_path / "scene", options)
    assert not (tmp_path / "scene").exists()


def test_another_calibration_is_refused_before_anything_is_watched(tmp_path, camera, detector):
    video = write_video(tmp_path / "yard.avi", seconds=2)
    detector()
    track(video, camera, tmp_path / "scene", TrackOptions(name="gate"))
    other = tmp_path / "other.json"
    CAMERA.disturbed(np.array([0, 0, 0, 0.1, 0.0])).save(other)
    used = detector()
    with pytest.raises(InputError, match="another calibration"):
        track(
            write_video(tmp_path / "b.avi", seconds=2),
            other,
            tmp_path / "scene",
            TrackOptions(name="gate"),
        )
    assert used.seen == []


def test_a_camera_that_moves_is_refused_by_a_resumed_run_too(
    tmp_path, camera, detector, monkeypatch
):
    monkeypatch.setattr(watching, "_CHUNK_S", 1.0)
    video = write_video(tmp_path / "yard.avi", shifts=[0] * 35 + [24] * 45)
    for _ in range(3):
        detector()
        with pytest.raises(InputError, match="the camera moves"):
            track(video, camera, tmp_path / "scene")


class Live(Source):
    """A stream: frames of the yard without an end."""

    name, image_size, timeline, fps = "rtsp://me:secret@cam/live", SIZE, None, float(FPS)
    warnings = ()

    def frames(self, indices=None):
        for index in range(10**6):
            yield Frame(index, index / FPS, ground())


@pytest.fixture
def live(monkeypatch):
    monkeypatch.setattr("scene4d.video.reader.open_source", lambda _: Live())


@pytest.mark.usefixtures("live")
def test_a_stream_is_watched_until_ctrl_c_and_each_time_is_a_run(tmp_path, camera, detector):
    """Also where both are said to have begun at one moment."""
    for _ in range(2):
        detector(until=40)
        options = TrackOptions(start=datetime.fromisoformat("2026-11-20T08:00:00+00:00"))
        run = track(Live.name, camera, tmp_path / "scene", options)
        assert run.tracks == {"person": 2, "car": 1}
    assert not any("secret" in str(path) for path in tmp_path.rglob("*"))
    scene = Scene.open(tmp_path / "scene")
    assert (len(scene.runs), scene.cameras) == (2, ("cam-live",))
    assert [len(scene.only(run.run)) for run in scene.runs] == [120, 120]
    assert len(np.unique(scene.tracks().track)) == 6


@pytest.mark.usefixtures("live")
def test_what_a_killed_stream_showed_is_in_the_scene(tmp_path, camera, detector, monkeypatch):
    """Nothing tidies up after a kill; what is older than two seconds must be there."""

    class Killed(BaseException):
        pass

    killed = detector()
    look = killed.look

    def until(frame):
        if frame.time_s >= 12:
            raise Killed
        return look(frame)

    killed.look = until
    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr("scene4d.store.writing.SceneWriter.abandon", lambda _: None)
        track(Live.name, camera, tmp_path / "scene")
    scene = Scene.open(tmp_path / "scene")
    assert 10 < scene.runs[0].span_s[1] < 12
    assert abs((datetime.now(UTC) - _start(scene)).total_seconds()) < 60
    detector(until=30)
    track(Live.name, camera, tmp_path / "scene")
    again = Scene.open(tmp_path / "scene")
    assert len(again.runs) == 2
    assert len(again.only(scene.runs[0].run)) == len(scene), "the first recording stays as it was"


def _start(scene):
    return datetime.fromtimestamp(scene.runs[0].start_ns / 1e9, UTC)


@pytest.mark.usefixtures("live")
def test_a_lost_stream_is_a_warning(tmp_path, camera, detector, monkeypatch):
    monkeypatch.setattr(Live, "warnings", ("cam: the stream was lost",))
    detector(until=40)
    assert "cam: the stream was lost" in track(Live.name, camera, tmp_path / "s").warnings


def test_a_moving_car_behind_people_is_not_drawn_towards_them():
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
    looks = [Look(frames, frames / FPS, found)]
    parts = follow(looks, Calibration.of_camera(CAMERA), 1.70, trusted=True)
    tracks = Tracks.concatenate([*parts])
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


@pytest.mark.parametrize("last", [10**8, 3 * 10**9])
def test_two_far_annotations_take_no_more_than_two(last):
    """Frames 0 and 1 are in one slot of 10 Hz."""
    found = Detections.from_boxes(SIZE, np.array([0, 1, last]), np.tile(car_box(CAR), (3, 1)))
    (look,) = looks_of(found, 10.0, 25.0)
    assert look.frame.tolist() == look.detections.frame.tolist() == [0, last]
    assert look.time_s.tolist() == [0.0, last / 25]


def test_short_pauses_between_annotated_frames_are_bridged_and_long_ones_are_not(tmp_path, camera):
    frames = [*range(20), *range(30, 50), *range(80, 100)]
    path = boxes_file(tmp_path, [(frame, 1) for frame in frames])
    track(None, camera, tmp_path / "s", TrackOptions(annotations=path, fps=10.0))
    found = Scene.open(tmp_path / "s").tracks()
    assert found.frame[~found.observed].tolist() == list(range(20, 30))
    assert found.observed.sum() == 60


def test_annotated_frames_have_the_times_of_the_footage(tmp_path, camera):
    """Half the frames at 20 Hz, half at 5 Hz: frame / mean rate would be off by more than 1 s."""
    step_s = np.repeat([0.05, 0.2], 40)
    times = np.concatenate([[0.0], np.cumsum(step_s)[:-1]])
    video = write_video(tmp_path / "yard.mkv", times_s=times)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(80)])
    track(video, camera, tmp_path / "s", TrackOptions(annotations=path, rate_hz=100.0))
    found = Scene.open(tmp_path / "s").tracks()
    np.testing.assert_allclose(found.time_s, times[found.frame], atol=1e-3)
    assert len(found) == 80
    track(video, camera, tmp_path / "t", TrackOptions(annotations=path, fps=10.0))
    told = Scene.open(tmp_path / "t").tracks()
    np.testing.assert_allclose(told.time_s, told.frame / 10, atol=1e-9)


def test_footage_is_remembered_beside_its_annotations(tmp_path, camera):
    video = write_video(tmp_path / "yard.avi", seconds=2)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    track(video, camera, tmp_path / "s", TrackOptions(annotations=path))
    (run,) = Scene.open(tmp_path / "s").runs
    assert run.provenance["source"] == str(video)
    assert run.provenance["annotations"] == str(path)
    assert run.camera == "yard"
    assert footage_of(run, None, alone=True) == video


def test_a_camera_that_sees_nobody_on_the_ground_is_told(tmp_path):
    """One that looks at the sky sees all feet above the horizon."""
    low = Camera.from_pose(
        image_size=SIZE, focal_px=600.0, tilt_rad=-0.6, roll_rad=0.0, height_m=3.0
    )
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    run = track(None, low, tmp_path / "s", TrackOptions(annotations=path, fps=10.0))
    assert run.without_position == run.rows == 20
    assert "20 of 20 rows have no position" in run.warnings[-1]
    good = track(None, CAMERA, tmp_path / "t", TrackOptions(annotations=path, fps=10.0))
    assert good.without_position == 0
    assert not good.warnings


@pytest.mark.parametrize(
    ("score", "body", "moves", "kept"),
    [
        (0.45, 0.2, False, False),  # a signpost
        (0.45, 0.2, True, True),
        (0.45, 0.6, False, True),  # seated, and seen badly
        (0.85, 0.4, False, True),
        (0.75, None, False, True),  # nobody looked for bodies
        (0.45, None, False, False),
    ],
)
def test_what_neither_moves_nor_has_a_body_is_nobody(score, body, moves, kept):
    rng = np.random.default_rng(1)
    n = 60
    frames = np.arange(n)
    box = np.array([person_box(places(t)[0] if moves else places(0)[0]) for t in frames / FPS])
    looked_for = (
        {}
        if body is None
        else {
            "keypoint_names": HALPE26,
            "keypoint_uv": np.full((n, 26, 2), 100.0),
            "keypoint_score": rng.uniform(body - 0.1, body + 0.1, (n, 26)),
        }
    )
    found = Detections.from_boxes(
        SIZE,
        frames,
        box + rng.normal(0, 0.5, (n, 4)),
        time_s=frames / FPS,
        score=np.full(n, score),
        **looked_for,
    )
    looks = [Look(frames, frames / FPS, found)]
    calibration = Calibration.of_camera(CAMERA)
    parts = follow(looks, calibration, 1.70, trusted=False)
    assert (sum(map(len, parts)) == n) is kept
    assert sum(map(len, follow(looks, calibration, 1.70, trusted=True))) == n


def test_what_is_seen_twice_is_nobody():
    frames = np.arange(4)
    found = Detections.from_boxes(
        SIZE, frames[:2], np.array([car_box([0.5, 20.0])] * 2), time_s=frames[:2] / FPS,
        class_name=np.array(["car", "car"]),
    )  # fmt: skip
    looks = [Look(frames, frames / FPS, found)]
    for trusted, rows in ((False, 0), (True, 2)):
        parts = follow(looks, Calibration.of_camera(CAMERA), 1.70, trusted=trusted)
        assert sum(map(len, parts)) == rows


def test_an_undetermined_calibration_is_no_camera(tmp_path):
    nothing = replace(Calibration.of_camera(CAMERA), camera=None)
    with pytest.raises(InputError, match="undetermined"):
        track("x.avi", nothing, tmp_path)


def test_annotations_of_other_footage_are_refused(tmp_path, camera):
    video = write_video(tmp_path / "yard.avi", seconds=1)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    with pytest.raises(InputError, match=r"annotates frame 19 .* has 10 frames"):
        track(video, camera, tmp_path / "scene", TrackOptions(annotations=path))
    assert not (tmp_path / "scene").exists()


def test_detections_and_annotations_of_one_clip_are_two_runs(tmp_path, camera, detector):
    video = write_video(tmp_path / "yard.avi", seconds=2)
    path = boxes_file(tmp_path, [(frame, 1) for frame in range(20)])
    detector()
    track(video, camera, tmp_path / "scene")
    track(video, camera, tmp_path / "scene", TrackOptions(annotations=path))
    assert [run.rows for run in Scene.open(tmp_path / "scene").runs] == [60, 20]


def test_a_single_picture_is_no_footage(tmp_path, camera):
    import cv2

    cv2.imwrite(str(tmp_path / "photo.png"), ground())
    with pytest.raises(InputError, match="is a single picture"):
        track(tmp_path / "photo.png", camera, tmp_path / "scene")
