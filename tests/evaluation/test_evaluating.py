"""What is tried on a recording whose camera is known, with a network that knows the answer."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from readings import belief_of, reading_of
from scene4d.calibration.orienting import OrientationReading
from scene4d.calibration.watching import Seen
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections, Segments
from scene4d.core.progress import Silent
from scene4d.evaluation import EvaluateOptions, Reference, evaluate_footage
from scene4d.evaluation.trials import _cameras as cameras
from scene4d.evaluation.trials import _methods as methods
from scene4d.evaluation.trials._methods import Input, trials
from strategies import build_camera, build_lens, people_scene

SIZE = (1280, 720)
CAMERA = build_camera(build_lens(SIZE, 55.0), 20.0, 1.0, 6.0)
FRAMES, EACH = 6, 6


@pytest.fixture(scope="module")
def reference() -> Reference:
    people = people_scene(CAMERA, 200, np.random.default_rng(1))
    return Reference("square", CAMERA, people.foot_uv)


@pytest.fixture
def footage(monkeypatch) -> Input:
    """Six people in each of six frames, of which the network has read five."""
    people = people_scene(CAMERA, FRAMES * EACH, np.random.default_rng(0), noise=0.01)
    frame = np.repeat(np.arange(FRAMES), EACH)
    segments = replace(Segments.from_points(people.foot_uv, people.head_uv), frame=frame)
    monkeypatch.setattr("scene4d.evaluation.trials._methods.person_segments", lambda _: segments)
    monkeypatch.setattr("scene4d.calibration.watching.person_segments", lambda _: segments)
    nobody = Detections.from_boxes(SIZE, np.empty(0, np.int64), np.empty((0, 4)))
    reading = reading_of(*[belief_of(CAMERA)] * (FRAMES - 1), image_size=SIZE)
    return Input("video", Seen(nobody, FRAMES, reading=reading))


def belief_reading(**wrong: float) -> OrientationReading:
    return replace(reading_of(belief_of(CAMERA, **wrong), image_size=SIZE), focal_known=False)


def test_the_network_has_its_rows_where_there_are_pictures(footage):
    truth = Orientation(CAMERA.focal_px, CAMERA.tilt_rad, CAMERA.roll_rad)
    tried = [t.setting for t in trials(footage, truth)]
    rows = {(s.footage, s.method) for s in tried if s.given == "network"}
    assert rows == {
        ("video, boxes", "paper"), ("video, boxes", "joint"), ("video, keypoints", "joint"),
    }  # fmt: skip
    assert len(tried) == len(set(tried))
    blind = replace(footage, seen=replace(footage.seen, reading=None))
    assert not any(t.setting.given == "network" for t in trials(blind, truth))


def test_where_the_lens_is_given_the_network_reads_straightened_pictures(footage, reference):
    truth = Orientation(CAMERA.focal_px, CAMERA.tilt_rad, CAMERA.roll_rad)
    assert not any("network" in t.setting.given and t.has_lens for t in trials(footage, truth))
    bent = replace(belief_reading(tilt_deg=2.0), lens=CAMERA.lens)
    lines = {
        t.setting.given: t
        for t in trials(replace(footage, straightened=bent), truth)
        if t.setting.footage.endswith("boxes") and "network" in t.setting.given and t.has_lens
    }
    assert set(lines) == {"distortion, network", "lens, network"}
    paper, joint = (lines[given] for given in ("distortion, network", "lens, network"))
    assert (paper.setting.method, joint.setting.method) == ("paper", "joint")
    # The paper undistorts and takes the network's focal length; a lens file's is believed.
    assert paper.seen.reading is bent
    assert joint.seen.reading.focal_known and joint.seen.reading.orientation.focal_sigma_px == 0.0
    found = paper.outcome(reference, 1.70).calibration
    np.testing.assert_allclose(found.camera.focal_px, bent.most_frequent.focal_px)
    np.testing.assert_allclose(found.camera.tilt_rad, bent.most_frequent.tilt_rad)
    held = joint.outcome(reference, 1.70).calibration
    np.testing.assert_allclose(held.camera.K, CAMERA.K)


def test_told_nothing_means_not_by_the_network_either(footage, reference):
    by_given = {
        t.setting.given: t.outcome(reference, 1.70).calibration
        for t in trials(footage, None)
        if t.setting.footage.endswith("keypoints")
    }
    nothing, network = by_given["nothing"], by_given["network"]
    assert nothing.camera is not None and network.camera is not None
    assert nothing.camera.focal_px != network.camera.focal_px


def test_lines_without_pictures_borrow_the_reading_of_the_same_camera(
    footage, reference, monkeypatch
):
    tried = []
    monkeypatch.setattr(cameras, "HEIGHTS_M", (1.70,))
    monkeypatch.setattr(cameras, "trials", lambda given, truth: tried.append(given) or ())
    blind = Input("drawn boxes", Seen(footage.seen.detections, 1))
    footage = replace(footage, straightened=belief_reading())
    found = cameras._evaluated("pets", reference, [footage, blind], ["first"], Silent())
    assert [given.seen.reading for given in tried] == [footage.seen.reading] * 2
    assert [given.straightened for given in tried] == [footage.straightened] * 2
    assert found.notes[0] == "first" and "the same camera" in found.notes[1]
    dark = cameras._evaluated("pets", reference, [blind], [], Silent())
    assert tried[-1].seen.reading is None
    assert "no pictures" in dark.notes[0]


def test_footage_of_your_own_is_held_against_its_true_camera(footage, monkeypatch, tmp_path):
    """The feet that are seen are the points; a reference of half the size is scaled to it."""
    cv2.imwrite(str(tmp_path / "one.png"), np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
    CAMERA.scaled_to((SIZE[0] // 2, SIZE[1] // 2)).save(tmp_path / "half.json")
    monkeypatch.setattr(cameras, "_watched", lambda *_: footage)
    monkeypatch.setattr(cameras, "person_segments", methods.person_segments)
    monkeypatch.setattr(cameras, "HEIGHTS_M", (1.7, 1.8))
    options, source = EvaluateOptions(), tmp_path / "one.png"
    found = evaluate_footage(source, tmp_path / "half.json", options, Silent())
    np.testing.assert_allclose(found.reference.camera.P, CAMERA.P, rtol=1e-6)
    assert found.reference.image_size == SIZE and found.reference.n_points == 12
    by_lens = [o for o in found.outcomes if o.setting.given == "lens" and o.score is not None]
    assert {o.calibration.person_height_m for o in by_lens} == {1.7, 1.8}
    assert all(
        o.score.error.mean_m < 2 * o.score.predicted_m
        for o in by_lens
        if o.calibration.person_height_m == 1.7
    )
    assert "the feet of the people seen" in found.notes[0]
