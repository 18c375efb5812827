from types import SimpleNamespace

import numpy as np
import pytest
import supervision as sv
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.body import HALPE26
from scene4d.core.tracks import CLASSES
from scene4d.perception.objects import ObjectDetector, one_per_vehicle


def seen(*rows):
    """Detections of (class, score, x1, y1, x2, y2)."""
    return sv.Detections(
        xyxy=np.array([r[2:] for r in rows], float).reshape(-1, 4),
        confidence=np.array([r[1] for r in rows], float),
        class_id=np.zeros(len(rows), int),
        data={"class_name": np.array([r[0] for r in rows])},
    )


class Script:
    def __init__(self, *rows):
        self.rows, self.calls = rows, 0

    def detect(self, image_bgr):
        self.calls += 1
        return seen(*self.rows) if self.rows else sv.Detections.empty()


class Points:
    names = ("head_top", "pelvis")

    def estimate(self, image_bgr, box_xyxy):
        uv = np.stack([box_xyxy[:, :2], box_xyxy[:, 2:]], axis=1)
        return uv, np.full(uv.shape[:2], 0.5)


FRAME = SimpleNamespace(index=7, time_s=0.7, image_bgr=np.zeros((120, 200, 3), np.uint8))
PERSON = ("person", 0.8, 20, 10, 40, 70)
BICYCLE = ("bicycle", 0.7, 10, 40, 60, 80)
CAR = ("car", 0.9, 100, 50, 160, 90)


def test_people_first_then_vehicles_with_empty_keypoints():
    people = Script(PERSON, ("person", 0.6, 70, 10, 90, 70), ("dog", 0.9, 0, 0, 9, 9))
    objects = ObjectDetector(people, Points(), Script(BICYCLE, CAR, ("person", 0.9, 0, 0, 9, 9)))
    found, colours, _ = objects.look(FRAME)
    assert found.class_name.tolist() == ["person", "person", "car", "bicycle"]
    assert found.score.tolist() == [0.8, 0.6, 0.9, 0.7]
    assert found.box_xyxy[2].tolist() == list(CAR[2:])
    assert found.frame.tolist() == [7] * 4
    assert found.time_s.tolist() == [0.7] * 4
    assert found.track.tolist() == [-1] * 4
    assert found.keypoint_uv[0].tolist() == [[20, 10], [40, 70]]
    assert np.isnan(found.keypoint_uv[2:]).all()
    assert found.keypoint_score.tolist() == [[0.5, 0.5]] * 2 + [[0, 0]] * 2
    assert colours.shape == (4, 48)
    assert colours.dtype == np.float32
    assert colours.sum(axis=1) == pytest.approx(1)


def test_a_rider_stays_a_person_beside_the_bicycle():
    found, *_ = ObjectDetector(Script(PERSON), None, Script(BICYCLE)).look(FRAME)
    assert found.class_name.tolist() == ["person", "bicycle"]


def test_one_detector_can_do_both():
    both = Script(PERSON, CAR, ("toaster", 0.9, 0, 0, 9, 9))
    found, *_ = ObjectDetector(both).look(FRAME)
    assert found.class_name.tolist() == ["person", "car"]
    assert both.calls == 1


def test_nothing_at_all_is_a_table_that_can_be_joined():
    objects = ObjectDetector(Script(), Points(), Script())
    found, colours, _ = objects.look(FRAME)
    assert len(found) == 0
    assert colours.shape == (0, 48)
    busy, *_ = ObjectDetector(Script(PERSON), Points(), Script(CAR)).look(FRAME)
    joined = type(found).concatenate([found, busy, found])
    assert joined.class_name.tolist() == ["person", "car"]
    assert joined.class_name.dtype == found.class_name.dtype


def test_time_is_counted_by_stage():
    objects = ObjectDetector(Script(PERSON), Points(), Script(CAR))
    objects.look(FRAME)
    once = dict(objects.timings)
    assert set(once) == {"detect people", "keypoints", "detect vehicles", "appearance"}
    objects.look(FRAME)
    assert all(objects.timings[stage] > once[stage] >= 0 for stage in once)


def test_the_same_vehicle_under_two_names_is_one_row():
    found = one_per_vehicle(
        seen(CAR, ("truck", 0.6, 102, 50, 163, 92), ("bus", 0.2, 99, 49, 158, 91))
    )
    assert found.data["class_name"].tolist() == ["car"]
    found = one_per_vehicle(seen(BICYCLE, ("motorcycle", 0.8, 11, 41, 60, 80)))
    assert found.data["class_name"].tolist() == ["motorcycle"]


def test_a_part_is_no_car_but_a_bicycle_before_a_car_and_a_car_before_a_bus_are():
    part = ("car", 0.5, 101, 51, 125, 80)
    assert len(one_per_vehicle(seen(CAR, part))) == 1
    bus = ("bus", 0.8, 90, 10, 190, 95)
    assert len(one_per_vehicle(seen(CAR, bus, ("bicycle", 0.4, 101, 51, 125, 80)))) == 3
    motorcycle = ("motorcycle", 0.4, 102, 52, 158, 90)
    assert len(one_per_vehicle(seen(CAR, motorcycle))) == 2
    beside = ("car", 0.5, 140, 55, 190, 92)
    assert len(one_per_vehicle(seen(CAR, beside))) == 2


corner = st.floats(0, 100).map(lambda v: round(v, 1))
side = st.floats(5, 60).map(lambda v: round(v, 1))
row = st.tuples(st.sampled_from([*CLASSES, "dog"]), corner, corner, side, side)


@given(st.lists(row, max_size=12), st.randoms(use_true_random=False))
def test_every_row_is_a_vehicle_seen_and_order_does_not_matter(rows, random):
    boxes = [
        (kind, 0.9 - 0.01 * k, x, y, x + w, y + h) for k, (kind, x, y, w, h) in enumerate(rows)
    ]
    found = one_per_vehicle(seen(*boxes))
    kept = set()
    if len(found):
        columns = zip(found.data["class_name"], found.confidence, found.xyxy, strict=True)
        kept = {(n, float(s), *map(float, b)) for n, s, b in columns}
    assert kept <= {(n, float(s), *map(float, b)) for n, s, *b in boxes}
    vehicles = [b for b in boxes if b[0] not in ("person", "dog")]
    assert bool(kept) == bool(vehicles)
    if vehicles:
        assert vehicles[0][1] == found.confidence[0]  # the best is never lost
    shuffled = list(boxes)
    random.shuffle(shuffled)
    again = one_per_vehicle(seen(*shuffled))
    assert np.array_equal(found.xyxy, again.xyxy)


@pytest.mark.weights
def test_pets_with_people_and_vehicles(detector, estimator, vehicle_detector, pets_frames):
    objects = ObjectDetector(detector, estimator, vehicle_detector)
    found, *_ = objects.look(pets_frames[50])
    assert found.keypoint_names == HALPE26
    assert sorted(found.class_name.tolist()) == ["car", "person", "person", "person", "truck"]
    assert (found.keypoint_score[found.class_name == "person"].mean(axis=1) > 0.3).all()
    told = objects.expecting(np.full(576, 100.0))
    assert told.people.expected_person_px is not None
    assert told.vehicles.expected_person_px is not None
    assert detector.expected_person_px is None
