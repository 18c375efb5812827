import gc
import weakref
from types import SimpleNamespace

import numpy as np
import pytest
import supervision as sv

from scene4d.core.body import HALPE26
from scene4d.core.errors import InputError
from scene4d.perception._tracking import Tracker
from scene4d.perception.people import PeopleDetector, detect_people
from scene4d.perception.stationary import stationary


class Script:
    """A detector that finds one person who walks to the right, and a dog."""

    def __init__(self, classes=True):
        self.calls = 0
        self.classes = classes

    def detect(self, image_bgr):
        u = 40.0 + 10 * self.calls
        self.calls += 1
        return sv.Detections(
            xyxy=np.array([[u, 20, u + 20, 80], [100, 60, 140, 80]]),
            confidence=np.array([0.9, 0.8]),
            class_id=np.array([0, 16]),
            data={"class_name": np.array(["person", "dog"])} if self.classes else {},
        )


class Points:
    names = ("head_top", "pelvis")

    def estimate(self, image_bgr, box_xyxy):
        uv = np.stack([box_xyxy[:, :2], box_xyxy[:, 2:]], axis=1)
        return uv, np.full(uv.shape[:2], 0.5)


def frames(count, *, size=(120, 200), time=lambda i: i / 2):
    for i in range(count):
        image = np.zeros((*size, 3), np.uint8)
        yield SimpleNamespace(index=10 * i, time_s=time(i), image_bgr=image)


def test_the_table_has_everything():
    seen = []
    people = PeopleDetector(Script(), Points())
    found = detect_people(frames(4), people, progress=lambda *a: seen.append(a))
    assert found.image_size == (200, 120)
    assert found.frame.tolist() == [0, 10, 20, 30]
    assert found.time_s.tolist() == [0, 0.5, 1, 1.5]
    assert found.track.tolist() == [0, 0, 0, 0]
    assert found.class_name.tolist() == ["person"] * 4
    assert found.keypoint_names == ("head_top", "pelvis")
    assert found.keypoint_uv[3].tolist() == [[70, 20], [90, 80]]
    assert found.score.tolist() == [0.9] * 4
    assert seen == [(1, 1), (2, 2), (3, 3), (4, 4)]


def test_a_detector_without_class_names_finds_only_people():
    found = detect_people(frames(1), PeopleDetector(Script(classes=False)))
    assert len(found) == 2
    assert found.keypoint_uv.shape == (2, 0, 2)


def test_no_time_or_no_tracker_means_no_tracks():
    untimed = detect_people(frames(2, time=lambda i: float("nan")), PeopleDetector(Script()))
    assert untimed.track.tolist() == [-1, -1]
    untracked = detect_people(frames(2), PeopleDetector(Script(), tracker=None))
    assert untracked.track.tolist() == [-1, -1]


def test_an_empty_street_is_an_empty_table():
    class Nobody:
        def detect(self, image_bgr):
            return sv.Detections.empty()

    found = detect_people(frames(3), PeopleDetector(Nobody(), Points(), Tracker()))
    assert len(found) == 0
    assert found.image_size == (200, 120)


def test_no_frames_and_changing_frames_are_refused():
    with pytest.raises(InputError, match="no frame"):
        detect_people(iter(()), PeopleDetector(Script()))
    mixed = [*frames(1), *frames(2, size=(100, 200))]
    with pytest.raises(InputError, match="frame 0: found 200x100 pixels, expected 200x120"):
        detect_people(mixed, PeopleDetector(Script()))


def test_pictures_are_let_go():
    alive = []

    def stream():
        for frame in frames(5):
            gc.collect()
            assert sum(ref() is not None for ref in alive) <= 1
            alive.append(weakref.ref(frame.image_bgr))
            yield frame
            del frame

    assert len(detect_people(stream(), PeopleDetector(Script(), Points()))) == 5


@pytest.mark.weights
def test_pets_end_to_end(detector, estimator, pets_frames, pets_truth):
    people = PeopleDetector(detector, estimator)
    frames = pets_frames[40:60]
    found = detect_people(frames, people)
    assert found.keypoint_names == HALPE26
    true = sum(len(pets_truth[f.index][0]) for f in frames)
    assert 0.85 * true < len(found) < 1.15 * true
    lengths = np.bincount(found.track)
    assert lengths[lengths > 2].sum() > 0.75 * len(found)
    assert not stationary(found).any()
