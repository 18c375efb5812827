"""People who go behind a parked vehicle: python -m benchmarks.hidden [--walks 200]

Simulated: a camera 5 m high, a van or a bus 12 to 25 m away, somebody who walks by behind it at
0.8 to 1.6 m/s and rests there for up to 10 s, or never comes out while somebody else does. Boxes
that the vehicle covers by half are missed, as is one in ten of the others. The table says how often
he has the same number when he comes out, by how long he was hidden, with hypotheses of where he may
be and without; how often the truth is inside the 95 % ellipse of the hypothesis; and how often
somebody else takes his number.
"""

import argparse
import itertools
from dataclasses import dataclass

import numpy as np

from benchmarks.tables import Rows, markdown
from scene4d.core.boxes import covered
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._association import GroundTracker

CAMERA = Camera.from_pose(
    image_size=(1280, 720), focal_px=1100.0, tilt_rad=0.25, roll_rad=0.01, height_m=5.0
)
STEP_S, SECONDS, MISSED = 0.1, 40.0, 0.1
PIXELS, METRES = 1.0, 0.15
"""Errors of boxes and of places on the ground."""
VEHICLES = ((5.0, 2.0, 2.4), (10.0, 2.5, 3.0))
BINS_S = (1.0, 3.0, 5.0, 8.0, 11.0, 15.0)
CHI2_95 = 5.991


@dataclass
class Walk:
    """Somebody's places by frame, NaN where he is not there, and the colours of his clothes."""

    xy: np.ndarray
    colour: np.ndarray
    height_m: float


@dataclass
class Outcome:
    hidden_s: float
    same: bool
    inside: list[bool]


def box_of(corners: np.ndarray) -> np.ndarray:
    uv = CAMERA.project(corners)[0]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def person_box(xy: np.ndarray, height_m: float) -> np.ndarray:
    return box_of(np.array([[xy[0] + s, xy[1], z] for s in (-0.25, 0.25) for z in (0, height_m)]))


def vehicle_box(xy: np.ndarray, size: tuple[float, float, float]) -> np.ndarray:
    length, width, height = size
    return box_of(
        np.array(
            [
                [xy[0] + dx, xy[1] + dy, z]
                for dx in (-length / 2, length / 2)
                for dy in (-width / 2, width / 2)
                for z in (0.1, height)
            ]
        )
    )


def walk(rng: np.random.Generator, at: np.ndarray, size: tuple, begin_s: float) -> Walk:
    """By behind the vehicle, from left to right or back, with a rest behind it."""
    clock = np.arange(0, SECONDS, STEP_S) - begin_s
    speed, side = rng.uniform(0.8, 1.6), rng.choice([-1.0, 1.0])
    depth_m = at[1] + size[1] / 2 + rng.uniform(0.5, 1.5)
    rest_s = rng.choice([0.0, rng.uniform(0, 10)])
    rests_m = rng.uniform(-0.25, 0.25) * size[0]
    reach_s = (rests_m + 6 + size[0] / 2) / speed
    moved = np.minimum(clock, reach_s) + np.maximum(0, clock - reach_s - rest_s)
    x = -6 - size[0] / 2 + speed * moved
    there = (clock >= 0) & (x < 6 + size[0] / 2)
    xy = np.column_stack([at[0] + side * x, np.full(len(x), depth_m)])
    return Walk(
        np.where(there[:, None], xy, np.nan), rng.dirichlet(np.ones(8)), rng.normal(1.7, 0.08)
    )


def followed(
    rng: np.random.Generator, people: list[Walk], at: np.ndarray, size: tuple, *, hypotheses: bool
) -> tuple[list[list[tuple[float, int]]], dict[int, list[bool]]]:
    """Times and numbers of each person's sightings; whether he was in the ellipse while hidden."""
    tracker = GroundTracker(camera=CAMERA if hypotheses else None)
    parked, numbers = vehicle_box(at, size), [[] for _ in people]
    inside: dict[int, list[bool]] = {k: [] for k in range(len(people))}
    for k, time_s in enumerate(np.arange(0, SECONDS, STEP_S)):
        boxes = {}
        for who, one in enumerate(people):
            if np.isfinite(one.xy[k]).all():
                box = person_box(one.xy[k], one.height_m)
                if covered(box, parked) < 0.5:
                    boxes[who] = box
                elif hypotheses and numbers[who]:
                    inside[who] += in_ellipse(tracker, numbers[who][-1][1], time_s, one.xy[k])
        seen = [who for who in boxes if rng.random() > MISSED]
        box = np.array([parked, *(boxes[who] for who in seen)])
        n = len(box)
        found = Detections.from_boxes(
            CAMERA.image_size, np.full(n, k), box + rng.normal(0, PIXELS, box.shape),
            class_name=np.array(["truck"] + ["person"] * len(seen)),
        )  # fmt: skip
        located = Located.nowhere(n)
        located.xy_m[:] = [at, *(people[who].xy[k] for who in seen)]
        located.xy_m[:] += rng.normal(0, METRES, (n, 2))
        located.covariance_m2[:] = np.eye(2) * METRES**2
        colour = np.array([np.full(8, 1 / 8), *(people[who].colour for who in seen)])
        label = tracker.update(float(time_s), found, located, colour)
        for who, number in zip(seen, label[1:].tolist(), strict=True):
            numbers[who].append((float(time_s), number))
    return numbers, inside


def in_ellipse(tracker: GroundTracker, number: int, time_s: float, xy: np.ndarray) -> list[bool]:
    hidden = tracker._hidden
    if hidden is None or number not in hidden:
        return []
    mean, covariance, _ = hidden.predicted(number, time_s)
    away = xy - mean[:2]
    return [bool(away @ np.linalg.solve(covariance[:2, :2], away) < CHI2_95)]


def passes(walks: int, *, hypotheses: bool) -> list[Outcome]:
    found = []
    for seed in range(walks):
        rng = np.random.default_rng(seed)
        size = VEHICLES[seed % len(VEHICLES)]
        at = np.array([rng.uniform(-2, 2), rng.uniform(12, 25)])
        numbers, inside = followed(rng, [walk(rng, at, size, 0.0)], at, size, hypotheses=hypotheses)
        times = np.array([time_s for time_s, _ in numbers[0]])
        longest = int(np.argmax(np.diff(times)))
        same = numbers[0][longest][1] == numbers[0][-1][1]
        found.append(Outcome(float(np.diff(times)[longest]), same, inside[0]))
    return found


def taken(walks: int, *, hypotheses: bool) -> float:
    """How often somebody who comes out has the number of somebody who went in for good."""
    count = 0
    for seed in range(walks):
        rng = np.random.default_rng(1000 + seed)
        size = VEHICLES[seed % len(VEHICLES)]
        at = np.array([rng.uniform(-2, 2), rng.uniform(12, 25)])
        enters, comes = walk(rng, at, size, 0.0), walk(rng, at, size, -rng.uniform(2.0, 6.0))
        within = np.abs(enters.xy[:, 0] - at[0]) < size[0] / 4
        enters.xy[np.argmax(within) :] = np.nan
        begin = int(np.argmax(np.abs(comes.xy[:, 0] - at[0]) < size[0] / 4))
        comes.xy[: max(begin, int(rng.uniform(8, 14) / STEP_S))] = np.nan
        numbers, _ = followed(rng, [enters, comes], at, size, hypotheses=hypotheses)
        first = {number for _, number in numbers[0]}
        count += any(number in first for _, number in numbers[1])
    return count / walks


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden", description=__doc__)
    parser.add_argument("--walks", type=int, default=200)
    asked = parser.parse_args()
    both = [passes(asked.walks, hypotheses=on) for on in (False, True)]
    rows: Rows = [["hidden for", "walks", "same number, without", "with", "inside 95 %"]]
    for low, high in itertools.pairwise(BINS_S):
        old, new = ([one for one in found if low <= one.hidden_s < high] for found in both)
        if not new or not old:
            continue
        inside = [is_in for one in new for is_in in one.inside]
        share = f"{np.mean(inside):.0%}" if inside else ""
        kept = [f"{np.mean([one.same for one in some]):.0%}" for some in (old, new)]
        rows.append([f"{low:g} to {high:g} s", str(len(new)), *kept, share])
    print(markdown(rows))
    shares = [taken(asked.walks, hypotheses=on) for on in (False, True)]
    said = f"{shares[0]:.1%} without, {shares[1]:.1%} with"
    print(f"\nNumber of somebody who entered, taken by another: {said}.")


if __name__ == "__main__":
    main()
