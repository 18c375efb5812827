"""Sizes of tracked people and vehicles, against objects whose sizes are known."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.vehicle_positions import PROFILES, body, boxes_of

from bodies import Crowd, cameras, with_keypoints
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Tracks
from scene4d.core.vehicle_shapes import SHAPES
from scene4d.store.log import Look
from scene4d.tracking.following import follow
from strategies import build_camera, build_lens

STEP_S = 0.25
LENGTH, WIDTH, HEIGHT = range(3)


def tracked(seen: Detections, calibration: Calibration, height_m: float = 1.70) -> Tracks:
    """What is known of one track in the end."""
    seen = replace(seen, track=np.zeros(len(seen), int), time_s=seen.frame * STEP_S)
    frames = np.unique(seen.frame)
    look = Look(frames, frames * STEP_S, seen)
    return list(follow([look], calibration, height_m, trusted=True))[-1]


def drive(camera: Camera, turn_rad: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Places and headings of a car about the middle of the picture, over ten seconds."""
    middle, _ = camera.locate(np.array(camera.image_size)[None] * [rng.uniform(0.4, 0.6), 0.6])
    time_s = np.arange(-5, 5, STEP_S)
    heading = rng.uniform(-np.pi, np.pi) + turn_rad * time_s / 10
    way = 3.0 * STEP_S * np.column_stack([np.cos(heading), np.sin(heading)])
    return middle + np.cumsum(way, axis=0) - way[: len(way) // 2].sum(axis=0), heading


def driven(camera: Camera, profile: str, turn_rad: float, rng: np.random.Generator):
    """A car of a random size, in boxes whose errors are partly the same in all frames, or None
    where the picture does not hold it.
    """
    shape = SHAPES["car"]
    size_m = shape.size_m * np.exp(rng.multivariate_normal(np.zeros(3), shape.log_covariance))
    xy_m, heading = drive(camera, turn_rad, rng)
    box, good = boxes_of(camera, body(profile), np.tile(size_m, (len(xy_m), 1)), heading, xy_m)
    extent = np.tile(box[:, 2:] - box[:, :2], 2)
    good &= ((box[:, :2] > 8) & (box[:, 2:] < np.array(camera.image_size) - 9)).all(axis=1)
    always, each = rng.normal(size=4), rng.normal(size=box.shape)
    box = box + np.hypot(1.0, 0.03 * extent) * always + np.hypot(1.0, 0.02 * extent) * each
    frames = np.flatnonzero(good & (extent > 15).all(axis=1))
    if len(frames) < 20:
        return None
    names = np.full(len(frames), "car")
    return size_m, Detections.from_boxes(camera.image_size, frames, box[frames], class_name=names)


@pytest.fixture(scope="module")
def cars():
    """Log errors of sizes and their standard deviations (n, 2, 3) of cars that turn."""
    rng = np.random.default_rng(3)
    found = []
    for camera in cameras(12):
        for profile in 3 * list(PROFILES):
            made = driven(camera, profile, rng.choice([-1, 1]) * np.pi / 2, rng)
            if made is not None:
                last = tracked(made[1], Calibration.of_camera(camera)).select(np.array([-1]))
                error = np.log(last.size_m[0] / made[0])
                found.append([error, last.size_sigma_m[0] / last.size_m[0]])
    return np.array(found)


def test_sizes_of_cars_err_as_they_say(cars):
    error, sigma = cars[:, 0], cars[:, 1]
    assert len(error) > 40
    z = error / sigma
    assert (np.sqrt((z**2).mean(axis=0)) > 0.7).all() and (np.sqrt((z**2).mean(axis=0)) < 1.3).all()
    assert 0.88 <= (np.abs(z) < 1.96).mean() <= 0.99
    population = np.sqrt(np.diag(SHAPES["car"].log_covariance))
    assert (np.sqrt((error**2).mean(axis=0)) < 0.9 * population)[[LENGTH, HEIGHT]].all()


def test_a_parked_car_is_not_known_better_for_being_seen_long():
    camera = build_camera(build_lens((1920, 1080), 50.0), 18.0, 3.0, 7.0)
    rng = np.random.default_rng(0)
    middle, _ = camera.locate(np.array(camera.image_size)[None] * [0.5, 0.55])
    size_m = SHAPES["car"].size_m[None]
    seen, _ = boxes_of(camera, body("saloon"), size_m, np.array([0.6]), middle)
    box = seen + rng.normal(0, 0.3, (80, 4))

    def sigma(frames: int) -> np.ndarray:
        names = np.full(frames, "car")
        seen = Detections.from_boxes(
            camera.image_size, np.arange(frames), box[:frames], class_name=names
        )
        return tracked(seen, Calibration.of_camera(camera)).size_sigma_m[-1]

    short, long = sigma(8), sigma(80)
    assert (long > 0.93 * short).all() and (long < 1.05 * short).all()


def walk(camera: Camera, height_m: float, rng: np.random.Generator) -> Detections:
    """A person who walks for ten seconds; sometimes the feet are hidden, sometimes he bends. All
    his sightings are too long or too short by one share.
    """
    n = 40
    start, _ = camera.locate(np.array(camera.image_size)[None] * [rng.uniform(0.4, 0.6), 0.6])
    yaw = rng.uniform(-np.pi, np.pi)
    way = 1.2 * STEP_S * (np.arange(n) - n / 2)[:, None] * [np.cos(yaw), np.sin(yaw)]
    seeming_m = np.full(n, height_m * (1 + 0.026 * rng.normal()))
    seeming_m[rng.random(n) < 0.1] -= 0.4
    people = Crowd(camera, start + way, seeming_m, np.full(n, yaw))
    seen = with_keypoints(people, rng)
    score = seen.keypoint_score.copy()
    score[rng.random(n) < 0.15, 20:] = 0.1
    inside = ((seen.box_xyxy > 0) & (seen.box_xyxy < np.tile(camera.image_size, 2))).all(axis=1)
    return replace(seen, frame=np.arange(n), keypoint_score=score).select(inside)


def test_heights_of_people_err_as_they_say():
    rng = np.random.default_rng(5)
    found = []
    for camera in cameras(8):
        for _ in range(8):
            height_m = 1.70 + 0.09 * rng.normal()
            seen = walk(camera, height_m, rng)
            if len(seen) > 15:
                last = tracked(seen, Calibration.of_camera(camera)).select(np.array([-1]))
                assert np.isnan(last.size_m[0, :HEIGHT]).all()
                found.append([last.size_m[0, HEIGHT] - height_m, last.size_sigma_m[0, HEIGHT]])
    error, sigma = np.array(found).T
    z = error / sigma
    assert len(z) > 40
    assert 0.75 < np.sqrt((z**2).mean()) < 1.3 and 0.85 <= (np.abs(z) < 1.96).mean() <= 0.99
    assert np.sqrt((error**2).mean()) < 0.06  # the population's is 0.09


def test_a_child_is_a_child_and_nobody_is_judged_by_one_glance():
    camera, rng = cameras(1)[0], np.random.default_rng(0)
    seen, calibration = walk(camera, 1.15, rng), Calibration.of_camera(camera)
    child = tracked(seen, calibration)
    assert abs(child.size_m[-1, HEIGHT] - 1.15) < 2.5 * child.size_sigma_m[-1, HEIGHT] < 0.2
    glance = tracked(seen.select(np.arange(1)), calibration)
    assert glance.size_sigma_m[0, HEIGHT] > 1.5 * child.size_sigma_m[-1, HEIGHT]


def test_an_uncertain_camera_makes_sizes_uncertain():
    camera, rng = cameras(1)[0], np.random.default_rng(1)
    seen = walk(camera, 1.75, rng)
    exact = tracked(seen, Calibration.of_camera(camera))
    covariance = np.diag([0.0, 0.0, 0.0, 0.1, 0.0]) ** 2
    loose = replace(Calibration.of_camera(camera), covariance=covariance)
    found = tracked(seen, loose)
    # A camera that may hang 10 % higher makes everybody 10 % taller: little but the prior is left.
    assert exact.size_sigma_m[-1, HEIGHT] < 0.06 < 0.08 < found.size_sigma_m[-1, HEIGHT] < 0.11
