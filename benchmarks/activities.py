"""A day of one camera searched for an activity, in memory: how long, and what is found.

    python benchmarks/activities.py [--people N] [--vehicles N] [--activity NAME]

The day is made: at 5 rows a second, people walk across a square of 120 m with a car park in it,
some of them up to a parked car, where they vanish; vehicles stand, or drive past. A camera on a
roof, whose error is known, sees all of it. N are rows. The whole command, with reading the scene
from the disk, is measured by ``python -m benchmarks.search``.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.search import find
from scene4d.searching.stages import stage_of

STEP_S = 0.2
FRAMES_PER_STEP = 6
DAY_S = 86_400.0
SIDE_M = 120.0
NEAREST_M = 60.0
STANDING_M, SEATED_M, CAR_M = 1.7, 1.0, 1.5
BENDING_ROWS = 5
WALK_ROWS, PARKED_ROWS, PASSING_ROWS = 200, 5_000, 60
BLOCK = 100  # every so many people, one enters a vehicle
NOISE = 0.1
CAMERA = Camera.from_pose(
    image_size=(1920, 1080), focal_px=1100.0, tilt_rad=0.4, roll_rad=0.01, height_m=40.0
)
# What a calibration from people typically leaves: 1 %, 0.3°, 0.2°, 1 %, and a lens half known.
SIGMA = np.array([0.01, 0.005, 0.004, 0.01, 0.002])


def calibration() -> Calibration:
    """That of the camera, with a covariance."""
    return replace(Calibration.of_camera(CAMERA), covariance=np.diag(SIGMA**2))


def synthetic_day(
    people: int = 1_000_000, vehicles: int = 100_000, seed: int = 0
) -> tuple[Tracks, dict[int, int]]:
    """A day, ordered by (track, time), and the car that each of those enters who enter one."""
    rng = np.random.default_rng(seed)
    parked = max(1, int(0.8 * vehicles) // PARKED_ROWS)
    passing = max(0, vehicles - parked * PARKED_ROWS) // PASSING_ROWS
    spots = np.column_stack(
        [10 + 5.0 * (np.arange(parked) % 20), 40 + 8.0 * (np.arange(parked) // 20)]
    )
    parked_at = np.sort(rng.uniform(0, DAY_S - PARKED_ROWS * STEP_S, parked))
    still = np.zeros((PARKED_ROWS, 2))
    tracks = [
        _track(rng, number, "car", begin, spot + still, still)
        for number, (spot, begin) in enumerate(zip(spots, parked_at, strict=True))
    ]
    for begin in rng.uniform(0, DAY_S - PASSING_ROWS * STEP_S, passing):
        speed = rng.uniform(5, 12)
        tracks.append(_straight(rng, len(tracks), "car", begin, PASSING_ROWS, speed))
    entering: dict[int, int] = {}
    for walk in range(people // WALK_ROWS):
        number = len(tracks)
        if walk % BLOCK == 0:
            car = int(rng.integers(parked))
            last = parked_at[car] + rng.uniform(WALK_ROWS + 50, PARKED_ROWS - 50) * STEP_S
            tracks.append(_arrival(rng, number, last - WALK_ROWS * STEP_S, spots[car]))
            entering[number] = car
        else:
            begin = rng.uniform(0, DAY_S - WALK_ROWS * STEP_S)
            speed = rng.uniform(0.8, 1.8)
            tracks.append(_straight(rng, number, "person", begin, WALK_ROWS, speed))
    return Tracks.concatenate(tracks), entering


def _straight(
    rng: np.random.Generator, number: int, kind: str, begin: float, rows: int, speed: float
) -> Tracks:
    """Straight across, through a random point of the square."""
    turn = rng.uniform(0, 2 * np.pi)
    velocity = np.tile(speed * np.array([np.cos(turn), np.sin(turn)]), (rows, 1))
    middle = rng.uniform(0, SIDE_M, 2)
    xy = middle + velocity * ((np.arange(rows) - rows / 2) * STEP_S)[:, None]
    return _track(rng, number, kind, begin, xy, velocity)


def _arrival(rng: np.random.Generator, number: int, begin: float, spot: np.ndarray) -> Tracks:
    """Somebody who walks up to a vehicle, bends down into it, and vanishes beside its middle."""
    turn = rng.uniform(0, 2 * np.pi)
    heading = np.array([np.cos(turn), np.sin(turn)])
    left = np.arange(WALK_ROWS)[::-1]
    away = 0.5 + 1.3 * STEP_S * left
    height_m = np.interp(left, [0, BENDING_ROWS], [SEATED_M, STANDING_M])
    velocity = np.tile(1.3 * heading, (WALK_ROWS, 1))
    xy = spot - away[:, None] * heading
    return _track(rng, number, "person", begin, xy, velocity, height_m)


def _track(
    rng: np.random.Generator,
    number: int,
    kind: str,
    begin: float,
    square_m: np.ndarray,
    velocity: np.ndarray,
    height_m: np.ndarray | None = None,
) -> Tracks:
    n = len(square_m)
    tick = round(begin / STEP_S) + np.arange(n)
    # The square lies in front of the camera.
    xy = square_m + np.array([-SIDE_M / 2, NEAREST_M]) + rng.normal(0, NOISE, (n, 2))
    return Tracks(
        track=np.full(n, number),
        class_name=np.full(n, kind),
        time_s=tick * STEP_S,
        frame=tick * FRAMES_PER_STEP,
        xy_m=xy,
        covariance_m2=np.tile(np.eye(2) * NOISE**2, (n, 1, 1)),
        shared_covariance_m2=np.zeros((n, 2, 2)),
        velocity_mps=velocity + rng.normal(0, NOISE, (n, 2)),
        velocity_covariance=np.tile(np.eye(2) * NOISE**2, (n, 1, 1)),
        heading_rad=np.arctan2(velocity[:, 1], velocity[:, 0]),
        heading_sigma_rad=np.full(n, 0.2),
        box_xyxy=_boxes(kind, xy, height_m),
        keypoint_uv=np.zeros((n, 0, 2)),
        keypoint_score=np.zeros((n, 0)),
        score=np.ones(n),
        observed=np.ones(n, bool),
    )


def _boxes(kind: str, xy_m: np.ndarray, height_m: np.ndarray | None) -> np.ndarray:
    """From the ground to the top, as wide as people and as cars from the side."""
    usual_m, half_width_m = (STANDING_M, 0.3) if kind == "person" else (CAR_M, 1.6)
    tall_m = np.full(len(xy_m), usual_m) if height_m is None else height_m
    foot, head = (CAMERA.project(np.column_stack([xy_m, z]))[0] for z in (0 * tall_m, tall_m))
    half = (foot[:, 1] - head[:, 1]) * half_width_m / tall_m
    return np.column_stack([foot[:, 0] - half, head[:, 1], foot[:, 0] + half, foot[:, 1]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=1_000_000)
    parser.add_argument("--vehicles", type=int, default=100_000)
    parser.add_argument("--activity", default="person_enters_vehicle")
    arguments = parser.parse_args()
    tracks, entering = synthetic_day(arguments.people, arguments.vehicles)
    activity = load_catalogue()[arguments.activity]
    begun = time.perf_counter()
    stage = stage_of(tracks, calibration())
    events = find(stage, activity)
    taken = time.perf_counter() - begun
    print(f"{len(stage.tracks):,} rows, {len(stage.first_row):,} tracks")
    print(f"{activity.name}: {len(events)} events in {taken:.2f} s")
    print(f"entered a vehicle: {len(entering)}")


if __name__ == "__main__":
    main()
