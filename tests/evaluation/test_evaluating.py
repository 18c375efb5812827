"""What is tried on a recording whose camera is known, with a network that knows the answer."""

from dataclasses import replace

import numpy as np
import pytest

from readings import belief_of, reading_of
from scene4d.calibration.watching import Seen
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections, Segments
from scene4d.core.progress import Silent
from scene4d.evaluation import Reference
from scene4d.evaluation.trials import _cameras as cameras
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
    found = cameras._evaluated("pets", reference, [footage, blind], ["first"], Silent())
    assert [given.seen.reading for given in tried] == [footage.seen.reading] * 2
    assert found.notes[0] == "first" and "the same camera" in found.notes[1]
    dark = cameras._evaluated("pets", reference, [blind], [], Silent())
    assert tried[-1].seen.reading is None
    assert "no pictures" in dark.notes[0]
