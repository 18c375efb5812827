"""Parked vehicles keep their numbers, and doubles of them are found."""

import numpy as np
import pytest

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.vehicle_shapes import SHAPES
from scene4d.store.log import Look
from scene4d.tracking._association import GroundTracker
from scene4d.tracking._vehicles import locate_vehicles
from scene4d.tracking.following import follow

SIZE, RATE_HZ = (1280, 720), 5.0
CAMERA = Camera.from_pose(
    image_size=SIZE, focal_px=1000.0, tilt_rad=0.2, roll_rad=0.0, height_m=6.0
)


def box(xy, kind="car"):
    """The box of a vehicle whose length lies along Y."""
    length, width, height = SHAPES[kind].size_m
    corners = np.array([
        [xy[0] + a * width / 2, xy[1] + b * length / 2, z]
        for a in (-1, 1) for b in (-1, 1) for z in (0.1, height)
    ])  # fmt: skip
    uv = CAMERA.project(corners)[0]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def seen(k, boxes, kinds):
    return Detections.from_boxes(
        SIZE, np.full(len(boxes), k), np.array(boxes).reshape(-1, 4),
        time_s=np.full(len(boxes), k / RATE_HZ), class_name=np.array(kinds, dtype="<U10"),
        score=np.full(len(boxes), 0.9),
    )  # fmt: skip


@pytest.mark.parametrize("distance_m", [15.0, 50.0])
def test_cars_that_were_hidden_for_minutes_keep_their_numbers(distance_m):
    rng = np.random.default_rng(3)
    cars = [np.array([x, distance_m]) for x in (-6.0, -3.0, 0.0, 3.0)]
    tracker, numbers = GroundTracker(), set()
    for k in [*range(50), *range(650, 700)]:  # two minutes unseen
        boxes = np.array([box(one) for one in cars])
        boxes += rng.normal(0, 0.04, boxes.shape) * np.tile(boxes[:, 2:] - boxes[:, :2], 2)
        found = seen(k, boxes, rng.choice(["car", "truck"], 4, p=[0.9, 0.1]))
        numbers |= set(tracker.update(k / RATE_HZ, found, locate_vehicles(found, CAMERA)).tolist())
    assert len(numbers) == 4


def tracks(frames):
    """The vehicles found: track numbers and rows of each."""
    looks = [Look(np.array([k]), np.array([k / RATE_HZ]), found) for k, found in enumerate(frames)]
    parts = list(follow(looks, Calibration.of_camera(CAMERA), 1.70, trusted=False))
    number, rows = np.unique(np.concatenate([part.track for part in parts]), return_counts=True)
    return dict(zip(number.tolist(), rows.tolist(), strict=True))


def pick_up(k, rng):
    """One vehicle, seen as a car, as a truck that reaches further back, or as both."""
    both = [box([1.0, 20.0]), box([1.0, 20.8], "truck")]
    kinds, jitter = ["car", "truck"], rng.normal(0, 1.0, (2, 4))
    which = [0, 1] if k < 60 else [1]
    return seen(k, np.array(both)[which] + jitter[which], [kinds[i] for i in which])


def test_a_car_that_is_also_a_truck_is_one_vehicle():
    rng = np.random.default_rng(0)
    found = tracks([pick_up(k, rng) for k in range(100)])
    assert list(found.values()) == [100]


def test_cars_side_by_side_and_in_a_row_stay_two():
    rng = np.random.default_rng(0)
    for other in ([3.4, 20.0], [1.0, 26.0]):
        boxes = np.array([box([1.0, 20.0]), box(other)])
        frames = [seen(k, boxes + rng.normal(0, 1.0, (2, 4)), ["car", "car"]) for k in range(60)]
        assert list(tracks(frames).values()) == [60, 60], other


def test_a_car_that_drives_past_another_is_no_double():
    def frame(k):
        return seen(k, [box([1.0, 20.0]), box([-12.0 + 0.35 * k, 24.0])], ["car", "car"])

    assert len(tracks([frame(k) for k in range(70)])) == 2
