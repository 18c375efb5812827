"""Made streets: lines of a map, and vehicles and people who keep to them, of known truth."""

import numpy as np

from made_tracks import made_tracks
from scene4d.alignment._anchors import tied
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks
from scene4d.formats.anchors import MapLine
from scene4d.store.site_errors import SiteErrors
from site_worlds import place

MAIN = np.array([[-60.0, 0.0], [-10.0, 0.0], [15.0, 6.0], [60.0, 30.0]])
SIDE = np.array([[-10.0, 0.0], [-16.0, -50.0]])
BACK = np.array([[40.0, 20.0], [28.0, 60.0]])
STREETS = (MAIN, SIDE, BACK)
LANE_M, KEPT_M, WEAVE_M, NOISE_M = 1.6, 1.2, 0.5, 0.1
FPS = 5.0


def tie(cameras, anchors):
    """:func:`tied`, the cameras erring each by itself."""
    errors = SiteErrors.none()
    for name, one in cameras.items():
        if one.placement:
            errors = errors.beside(SiteErrors.alone(name, one.placement, one.calibration))
    return tied(cameras, anchors, errors)


def lines(*streets: np.ndarray, kinds: tuple[int, ...] = (0, 1)) -> tuple[MapLine, ...]:
    return tuple(MapLine(one, kinds) for one in streets or STREETS)


def truth(rng: np.random.Generator) -> Placement:
    """A frame of a site on the map."""
    x, y = rng.uniform(-40, 40, 2)
    return place(x, y, rng.uniform(-180, 180), np.exp(rng.normal(0, 0.04)))


def drive(rng, street, side_m, way_m=(40.0, 70.0)):
    """Positions along a part of a street, one way or the other, to its right."""
    steps = np.diff(street, axis=0)
    at = np.append(0.0, np.cumsum(np.hypot(*steps.T)))
    length = min(rng.uniform(*way_m), at[-1])
    begin = rng.uniform(0, at[-1] - length)
    along = np.linspace(begin, begin + length, int(length / 8.0 * FPS) + 5)
    xy = np.column_stack([np.interp(along, at, street[:, k]) for k in (0, 1)])
    if rng.random() < 0.5:
        xy = xy[::-1]
    ahead = np.gradient(xy, axis=0)
    right = (ahead / np.hypot(*ahead.T)[:, None]) @ np.array([[0.0, -1.0], [1.0, 0.0]])
    knots = np.arange(0.0, length + 5, 5)
    weave = np.interp(along - begin, knots, rng.normal(0, WEAVE_M, len(knots)))
    return xy + (side_m + rng.normal(0, KEPT_M) + weave)[:, None] * right


def traffic(rng, frame, streets=STREETS, count=25, strays=0.15, kind="car", side_m=LANE_M):
    """Tracks of a site whose frame in the map's is ``frame``, some of them across country."""
    back, parts = frame.inverse(), []
    for track in range(count):
        if rng.random() < strays:
            a, b = rng.uniform(-30, 30, (2, 2))
            xy = a + np.linspace(0, 1, 60)[:, None] * (b - a)
        else:
            xy = drive(rng, streets[rng.integers(len(streets))], side_m)
        parts.append(rows(track, kind, back.points(xy + rng.normal(0, NOISE_M, xy.shape))))
    return Tracks.concatenate(parts)


def rows(track, kind, xy) -> Tracks:
    return made_tracks(
        track, np.arange(len(xy)) / FPS, xy, class_name=kind, covariance_m2=0.04,
        velocity_covariance=0.04, score=0.9, existence_probability=0.95,
    )  # fmt: skip
