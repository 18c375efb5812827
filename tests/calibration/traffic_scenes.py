"""Traffic whose truth is known: vehicles of known sizes that drive before a known camera."""

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.vehicle_shapes import SHAPES
from strategies import build_camera, build_lens

STEP_S, SPEED_MPS = 0.15, 12.0
SHARES = {"car": 0.85, "truck": 0.1, "bus": 0.05}


def street_camera(rng: np.random.Generator) -> Camera:
    """A camera above a street: 25 to 60° of view, 8 to 30° down, 4 to 14 m high."""
    lens = build_lens((1280, 720), rng.uniform(25, 60))
    height_m = float(np.exp(rng.uniform(np.log(4), np.log(14))))
    return build_camera(lens, rng.uniform(8, 30), rng.normal(0, 2), height_m)


def drive(
    camera: Camera,
    rng: np.random.Generator,
    vehicles: int = 30,
    *,
    roads: int = 1,
    bend_per_m: float = 0.0,
    jitter: float = 0.02,
    shape: float = 0.02,
    fleet: float = 1.0,
    spread: float = 1.0,
) -> Detections:
    """Tracked boxes of vehicles on roads of random directions through the view.

    ``jitter`` is the error of every edge and ``shape`` that which a vehicle keeps, as shares of the
    box; ``spread`` scales the spread of sizes within a class and ``fleet`` that of their means.
    """
    width, height = camera.image_size
    uv = rng.uniform([0.1 * width, 0.2 * height], [0.9 * width, 0.95 * height], (400, 2))
    places, valid = camera.locate(uv)
    places = places[valid & (np.hypot(*places.T) < 25 * camera.height_m)]
    directions = rng.uniform(0, np.pi, roads)
    mean = fleet * rng.normal(0, 1) * np.array([0.06, 0.05, 0.04])
    rows = []
    for track in range(vehicles):
        kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        body = SHAPES[kind]
        own = spread * rng.multivariate_normal(np.zeros(3), body.log_covariance)
        points = body.headed * body.size_m * np.exp(mean + own)
        place, kept = places[rng.integers(len(places))], rng.normal(0, shape, 4)
        first = directions[rng.integers(roads)] + np.pi * rng.integers(2)
        for step in range(-20, 20):
            way = step * STEP_S * SPEED_MPS
            heading = first + bend_per_m * way
            half = first + bend_per_m * way / 2  # the chord of an arc
            at = place + way * np.array([np.cos(half), np.sin(half)])
            box = _box(camera, at, heading, points)
            if box is None:
                continue
            side = np.tile(box[2:] - box[:2], 2)
            box = box + side * (kept + rng.normal(0, jitter, 4))
            rows.append((step + 20, track, kind, box))
    rows.sort(key=lambda row: row[0])
    frame = np.array([row[0] for row in rows])
    return Detections.from_boxes(
        camera.image_size,
        frame,
        np.array([row[3] for row in rows]).reshape(-1, 4),
        time_s=frame * STEP_S,
        track=np.array([row[1] for row in rows]),
        class_name=np.array([row[2] for row in rows]),
    )


def _box(camera: Camera, at: np.ndarray, heading: float, points: np.ndarray) -> np.ndarray | None:
    """The box of a vehicle that is wholly in the picture, else None."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s], [s, c]])
    uv, valid = camera.project(np.column_stack([at + points[:, :2] @ turn.T, points[:, 2]]))
    if not valid.all():
        return None
    uv = camera.distort(uv)[0]
    low, high = uv.min(axis=0), uv.max(axis=0)
    inside = (low >= 0).all() and (high <= np.array(camera.image_size) - 1).all()
    return np.concatenate([low, high]) if inside and (high - low).min() > 20 else None
