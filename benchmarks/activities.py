"""A day of one camera searched for "person enters vehicle": how long, and what is found.

    python benchmarks/activities.py [--people N] [--vehicles N] [--activity NAME]

The day is made: at 5 rows a second, people walk across a square of 120 m with a car park in it,
some of them up to a parked car, where they vanish; vehicles stand, or drive past. N are rows.
"""

import argparse
import time

import numpy as np

from scene4d.activities.catalogue import load_catalogue
from scene4d.activities.search import find
from scene4d.model import Tracks
from scene4d.predicates.rows import Stage

STEP_S = 0.2
DAY_S = 86_400.0
SIDE_M = 120.0
WALK_ROWS, PARKED_ROWS, PASSING_ROWS = 200, 5_000, 60
BLOCK = 100  # every so many people, one enters a vehicle


def synthetic_day(
    people: int = 1_000_000, vehicles: int = 100_000, seed: int = 0
) -> tuple[Stage, int]:
    """A day, and how many people enter a vehicle in it."""
    rng = np.random.default_rng(seed)
    parked = max(1, int(0.8 * vehicles) // PARKED_ROWS)
    passing = max(0, vehicles - parked * PARKED_ROWS) // PASSING_ROWS
    walks = people // WALK_ROWS
    spots = np.column_stack(
        [10 + 5.0 * (np.arange(parked) % 20), 40 + 8.0 * (np.arange(parked) // 20)]
    )
    parked_at = np.sort(rng.uniform(0, DAY_S - PARKED_ROWS * STEP_S, parked))
    tracks, number = [], 0
    for spot, begin in zip(spots, parked_at, strict=True):
        still = np.zeros((PARKED_ROWS, 2))
        tracks.append(_track(rng, number, "car", begin, spot + still, still))
        number += 1
    for begin in rng.uniform(0, DAY_S - PASSING_ROWS * STEP_S, passing):
        tracks.append(_straight(rng, number, "car", begin, PASSING_ROWS, rng.uniform(5, 12)))
        number += 1
    entering = 0
    for walk in range(walks):
        if walk % BLOCK == 0:
            car = rng.integers(parked)
            last = parked_at[car] + rng.uniform(WALK_ROWS + 50, PARKED_ROWS - 50) * STEP_S
            begin = last - WALK_ROWS * STEP_S
            tracks.append(_arrival(rng, number, begin, spots[car]))
            entering += 1
        else:
            begin = rng.uniform(0, DAY_S - WALK_ROWS * STEP_S)
            tracks.append(_straight(rng, number, "person", begin, WALK_ROWS, rng.uniform(0.8, 1.8)))
        number += 1
    return Stage(Tracks.concatenate(tracks), (1920, 1080), STEP_S), entering


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
    """Somebody who walks up to a vehicle and vanishes a metre beside it."""
    turn = rng.uniform(0, 2 * np.pi)
    heading = np.array([np.cos(turn), np.sin(turn)])
    away = 1.0 + 1.3 * STEP_S * np.arange(WALK_ROWS)[::-1]
    velocity = np.tile(1.3 * heading, (WALK_ROWS, 1))
    return _track(rng, number, "person", begin, spot - away[:, None] * heading, velocity)


def _track(
    rng: np.random.Generator,
    number: int,
    kind: str,
    begin: float,
    xy: np.ndarray,
    velocity: np.ndarray,
) -> Tracks:
    n = len(xy)
    first = round(begin / STEP_S)
    tick = first + np.arange(n)
    noise = 0.1
    # A picture from far above: 8 pixels a metre, in its middle, so that nobody walks out of it
    # before the day's square ends.
    middle = 960 + 8 * (xy - SIDE_M / 2) * [1.0, 0.5] - [0, 420]
    half = np.array([4.0, 9.0]) if kind == "person" else np.array([18.0, 9.0])
    return Tracks(
        track=np.full(n, number),
        class_name=np.full(n, kind),
        time_s=tick * STEP_S,
        frame=tick * 6,
        xy_m=xy + rng.normal(0, noise, (n, 2)),
        covariance_m2=np.tile(np.eye(2) * noise**2, (n, 1, 1)),
        shared_covariance_m2=np.zeros((n, 2, 2)),
        velocity_mps=velocity + rng.normal(0, noise, (n, 2)),
        velocity_covariance=np.tile(np.eye(2) * noise**2, (n, 1, 1)),
        heading_rad=np.arctan2(velocity[:, 1], velocity[:, 0]),
        heading_sigma_rad=np.full(n, 0.2),
        box_xyxy=np.hstack([middle - half, middle + half]),
        keypoint_uv=np.zeros((n, 0, 2)),
        keypoint_score=np.zeros((n, 0)),
        score=np.ones(n),
        observed=np.ones(n, bool),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=1_000_000)
    parser.add_argument("--vehicles", type=int, default=100_000)
    parser.add_argument("--activity", default="person_enters_vehicle")
    arguments = parser.parse_args()
    stage, entering = synthetic_day(arguments.people, arguments.vehicles)
    activity = load_catalogue()[arguments.activity]
    begun = time.perf_counter()
    events = find(stage, activity)
    taken = time.perf_counter() - begun
    print(f"{len(stage.tracks):,} rows, {len(stage.first_row):,} tracks")
    print(f"{activity.name}: {len(events)} events in {taken:.2f} s")
    print(f"entered a vehicle: {entering}")


if __name__ == "__main__":
    main()
