"""Tracks made by hand, and predicates whose values are written on them."""

import numpy as np
import pytest

from made_tracks import made_tracks
from scene4d.core.tracks import Tracks
from scene4d.searching.predicates._registry import PREDICATES, Parameter, Predicate
from scene4d.searching.predicates.stage import Stage

STEP_S = 0.2
SIZE = (1920, 1080)


def track(
    number: int,
    xy: np.ndarray | list,
    *,
    begin_s: float = 0.0,
    kind: str = "person",
    velocity: np.ndarray | None = None,
    lit: np.ndarray | None = None,
    box: np.ndarray | None = None,
    sigma_m: float = 0.1,
    step_s: float = STEP_S,
) -> Tracks:
    """One object at every step; ``lit`` is a probability per row that the fakes read."""
    xy = np.atleast_2d(np.asarray(xy, float))
    n = len(xy)
    if velocity is None:
        velocity = np.gradient(xy, step_s, axis=0) if n > 1 else np.zeros((n, 2))
    time_s = begin_s + step_s * np.arange(n)
    # Ten pixels a metre about the middle of the picture.
    middle = np.array([960.0, 540.0]) + 10 * xy * [1, -1]
    if box is None:
        box = np.hstack([middle - np.array([4, 17]), middle + np.array([4, 0])])
    return made_tracks(
        number, time_s, xy, class_name=kind, frame=np.rint(time_s * 30).astype(int),
        covariance_m2=sigma_m**2, velocity_mps=velocity, velocity_covariance=0.05**2,
        heading_sigma_rad=0.2, box_xyxy=box,
        score=1.0 if lit is None else np.asarray(lit, float),
    )  # fmt: skip


def stage(*tracks: Tracks, step_s: float = STEP_S, **places) -> Stage:
    """The tracks of a camera."""
    ordered = sorted(tracks, key=lambda one: int(one.track[0]))
    return Stage(Tracks.concatenate(ordered), SIZE, step_s, **places)


def stay(xy, seconds: float, step_s: float = STEP_S) -> np.ndarray:
    """Standing at a place."""
    return np.tile(np.asarray(xy, float), (round(seconds / step_s), 1))


def walk(start, end, *, speed: float = 1.4, step_s: float = STEP_S) -> np.ndarray:
    """Straight from one place to the other, which is reached in the last row."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    steps = max(1, int(np.linalg.norm(end - start) / (speed * step_s)))
    return end - (end - start) * (np.arange(steps)[::-1] / steps)[:, None]


def _lit(a):
    return a.stage.tracks.score[a.index]


def _sharp(a, b, *, tau_m=4.0):
    apart = np.linalg.norm(a.xy_m - b.xy_m, axis=1)
    return np.where(np.isnan(apart), np.nan, (apart < tau_m).astype(float))


def _same_lit(a, b):
    return np.sqrt(_lit(a) * _lit(b))


def _none(a):
    return np.full(len(a), np.nan)


_TAU = {"tau_m": Parameter("tau_m", 4.0, "m", 0.0, 1000.0)}
_FAKES = (
    Predicate("lit", 1, {}, _lit),
    Predicate("by", 2, _TAU, _sharp, holds="within", symmetric=True),
    Predicate("both_lit", 2, {}, _same_lit),
    Predicate("unknown", 1, {}, _none),
)


@pytest.fixture(autouse=True, scope="module")
def fakes():
    """They are predicates as any other for the tests of a module that imports this."""
    with pytest.MonkeyPatch.context() as patch:
        for one in _FAKES:
            patch.setitem(PREDICATES, one.name, one)
        yield
