"""The tracks of one camera as alignment reads them, and their paths at the ticks of a common step.

Errors of a position come in three kinds. Its own (``covariance_m2``) is gone a second later. What a
track carries along (where its boxes end) stays as long as the track. What the camera itself errs
by moves everything it sees, in few ways: its *modes*.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.columns import Columns
from scene4d.core.tracks import VEHICLES, Tracks

STEP_S = 0.5
"""Time between two ticks (s). Chosen: people turn within a second or two."""
MODES = 8
"""How many ways a camera errs in: the seven of its calibration, and the pull along its rays."""
_GAP_S = 1.5
"""A track is not bridged over longer gaps (s). Chosen: within it a walker can turn only once."""
_LEAST_BELIEF = 0.5
"""Tracks less probable than this are left out, as in tracking."""
_PULL_SIGMA_M = 0.10
"""Standard deviation (m) of what all positions of a camera err by along its rays: where detectors
see the ends of bodies. docs/tracking.md: the middle of a person from boxes and keypoints errs by
about as much on PETS and on TownCentre."""
_FAR_M = 1.0
"""Below this distance from the camera the pull fades (m), for it has no direction there."""


@dataclass(frozen=True, eq=False)
class View:
    """What one camera saw: rows of tracks ordered by (track, time), all with positions.

    ``kind`` is 0 for people and 1 for vehicles.
    """

    name: str
    track: Int[np.ndarray, "n"]
    time_s: Float[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    velocity_mps: Float[np.ndarray, "n 2"]
    kind: Int[np.ndarray, "n"]
    calibration: Calibration

    def __len__(self) -> int:
        return len(self.track)

    @cached_property
    def modes_m(self) -> Float[np.ndarray, "n 2 k"]:
        """:func:`error_modes` at the rows."""
        return error_modes(self.calibration, self.xy_m)

    @cached_property
    def pieces(self) -> Int[np.ndarray, "n"]:
        """Number of the stretch without a gap that each row belongs to."""
        new = np.diff(self.track, prepend=self.track[:1] - 1) != 0
        new |= np.diff(self.time_s, prepend=0.0) > _GAP_S
        return np.cumsum(new) - 1

    @cached_property
    def ends(self) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
        """First and last row of every piece."""
        first = np.flatnonzero(np.diff(self.pieces, prepend=-1))
        return first, np.append(first[1:], len(self))[: len(first)] - 1

    @cached_property
    def paths(self) -> "Paths":
        """The tracks at the ticks of the camera's own clock."""
        return _paths(self)


@dataclass(frozen=True, eq=False)
class Paths(Columns):
    """Tracks at whole ticks of :data:`STEP_S`, ordered by (piece, tick).

    ``piece`` numbers stretches without a gap; ``row`` is the nearest row of the view.
    """

    piece: Int[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    tick: Int[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    velocity_mps: Float[np.ndarray, "n 2"]
    kind: Int[np.ndarray, "n"]
    row: Int[np.ndarray, "n"]
    noise_m2: Float[np.ndarray, "n"]
    shared_m2: Float[np.ndarray, "n"]

    def mirrored(self) -> "Paths":
        """The same in a mirror (x to -x), which no camera is: what fits it fits by accident."""
        flip = np.array([-1.0, 1.0])
        return replace(self, xy_m=self.xy_m * flip, velocity_mps=self.velocity_mps * flip)


def ranges(
    first: Int[np.ndarray, "k"], count: Int[np.ndarray, "k"]
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """The numbers of k ranges, one range after the other: of each its range, and itself."""
    of = np.repeat(np.arange(len(count)), count)
    return of, np.arange(len(of)) + np.repeat(first - np.cumsum(count) + count, count)


def view_of(name: str, tracks: Tracks, calibration: Calibration) -> View:
    """A camera's tracks with the errors that its calibration admits to.

    Rows without a position, and tracks that are hardly believed, are left out.
    """
    belief = np.nan_to_num(tracks.existence_probability, nan=1.0)
    known = np.isfinite(tracks.xy_m).all(axis=1) & (belief >= _LEAST_BELIEF)
    known &= np.isfinite(tracks.covariance_m2).all(axis=(1, 2))
    rows = np.flatnonzero(known)
    rows = rows[np.lexsort((tracks.time_s[rows], tracks.track[rows]))]
    xy = tracks.xy_m[rows]
    velocity = tracks.velocity_mps[rows]
    missing = ~np.isfinite(velocity).all(axis=1)
    if missing.any():
        slopes = _slopes(tracks.track[rows], tracks.time_s[rows], xy)
        velocity = np.where(missing[:, None], slopes, velocity)
    return View(
        name=name,
        track=tracks.track[rows],
        time_s=tracks.time_s[rows],
        xy_m=xy,
        covariance_m2=tracks.covariance_m2[rows],
        velocity_mps=velocity,
        kind=np.isin(tracks.class_name[rows], VEHICLES).astype(int),
        calibration=calibration,
    )


def error_modes(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 k"]:
    """By how much ground points move per standard deviation of the camera's :data:`MODES`
    independent errors.

    They are the columns of a root of the calibration's covariance, and last the pull along the
    rays. A camera without covariance has only the pull.
    """
    root = covariance_root(calibration)
    modes = np.zeros((len(xy_m), 2, MODES))
    far = np.linalg.norm(xy_m, axis=1, keepdims=True)
    modes[:, :, -1] = _PULL_SIGMA_M * xy_m / np.maximum(far, _FAR_M)
    if root.any() and len(xy_m):
        uv, _ = calibration.ground_pixels(xy_m)
        _, jacobian, valid = calibration.ground_jacobian(uv)
        modes[valid, :, :-1] = jacobian[valid] @ root
    return modes


def corrected(calibration: Calibration, errors: Float[np.ndarray, "k"]) -> Calibration:
    """The calibration without these errors, in standard deviations of its :data:`MODES`; the last,
    which is none of the camera, aside. Its covariance stays.
    """
    if calibration.camera is None or not errors[:-1].any():
        return calibration
    step = covariance_root(calibration) @ errors[:-1]
    return replace(calibration, camera=calibration.camera.disturbed(-step))


def regrounded_points(
    before: Calibration, after: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2"]:
    """Ground points of one camera where another sees them at the same pixels."""
    if after is before:
        return xy_m
    uv, _ = before.ground_pixels(xy_m)
    assert after.camera is not None
    found, valid = after.camera.locate(uv, after.ground_height_m(uv)[0])
    moved: np.ndarray = np.where(valid[:, None], found, xy_m)
    return moved


def covariance_root(calibration: Calibration) -> Float[np.ndarray, "7 7"]:
    """A root L of the calibration's covariance, L Lᵀ, in order of falling size."""
    size, axes = np.linalg.eigh(calibration.parameter_covariance)
    root: np.ndarray = (axes * np.sqrt(np.maximum(size, 0.0)))[:, ::-1]
    return root


def _slopes(track: np.ndarray, time_s: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Velocities from neighbouring rows of the same track; zero where there is none."""
    before, after = np.arange(len(xy)) - 1, np.arange(len(xy)) + 1
    before = np.where((before >= 0) & (track[before] == track), before, before + 1)
    after = np.where((after < len(xy)) & (track[after % len(xy)] == track), after, after - 1)
    span = time_s[after] - time_s[before]
    step = xy[after] - xy[before]
    return step / np.where(span > 0, span, np.inf)[:, None]


def _paths(view: View) -> Paths:
    """Rows between ticks by Hermite interpolation, so that smoothed turns are kept."""
    first, last = view.ends
    begin = np.ceil(view.time_s[first] / STEP_S - 1e-6).astype(int)
    count = np.floor(view.time_s[last] / STEP_S + 1e-6).astype(int) - begin + 1
    of, tick = ranges(begin, np.maximum(count, 0))
    left, xy = interpolated(view, of, tick * STEP_S)
    modes = view.modes_m[left]
    return Paths(
        piece=of,
        track=view.track[left],
        tick=tick,
        xy_m=xy,
        velocity_mps=view.velocity_mps[left],
        kind=view.kind[left],
        row=left,
        noise_m2=np.trace(view.covariance_m2[left], axis1=1, axis2=2) / 2,
        shared_m2=(modes**2).sum(axis=(1, 2)) / 2,
    )


def interpolated(
    view: View, of: Int[np.ndarray, "m"], time_s: Float[np.ndarray, "m"]
) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m 2"]]:
    """The nearest rows and the positions of pieces ``of`` at times within them."""
    if not len(of):
        return np.zeros(0, int), np.zeros((0, 2))
    span = float(np.ptp(view.time_s)) + 2 * _GAP_S
    start = float(view.time_s.min())
    key = view.pieces * span + (view.time_s - start)
    at = np.searchsorted(key, of * span + (time_s - start), side="right") - 1
    first, last = view.ends
    left = np.clip(at, first[of], last[of])
    right = np.minimum(left + 1, last[of])
    gap = view.time_s[right] - view.time_s[left]
    u = np.where(gap > 0, (time_s - view.time_s[left]) / np.where(gap > 0, gap, 1.0), 0.0)
    u, gap = np.clip(u, 0.0, 1.0)[:, None], gap[:, None]
    p, q = view.xy_m[left], view.xy_m[right]
    v, w = view.velocity_mps[left] * gap, view.velocity_mps[right] * gap
    xy = (
        (1 + 2 * u) * (1 - u) ** 2 * p
        + u * (1 - u) ** 2 * v
        + u**2 * (3 - 2 * u) * q
        + u**2 * (u - 1) * w
    )
    return np.where(u[:, 0] > 0.5, right, left), xy
