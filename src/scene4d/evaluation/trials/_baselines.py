"""Baselines of a search: activities in pixels and in box sizes, P(near) alone, ends of tracks."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity, Phase
from scene4d.searching.predicates.stage import Stage

_NEAR = "near"
_WINDOW_S = 1.0
"""Velocities in the image are slopes of a straight line through this much of a track. Chosen by
hand on the tuning cameras: shorter windows are noisier, longer ones blur a turn."""
NOISE_SHARE = 0.02
"""Standard deviation of a box's foot, as a share of the box's height. Chosen by hand on the tuning
cameras."""
_SLOW_SIGMAS = 3.0
"""An object that moves by less than this many standard deviations has no heading of its own: the
usual three."""


def near_alone(activity: Activity) -> Activity | None:
    """The activity without any predicate but ``near``, in the phases that have it.

    Each lasts at least its minimum, with no maximum; the pause before a phase grows by the phases
    that are left out before it. None for an activity without ``near``.
    """
    kept: list[Phase] = []
    gap_s = 0.0
    for phase in activity.phases:
        terms = tuple(t for t in phase.terms if t.predicate == _NEAR and not t.negated)
        gap_s += phase.gap_s
        if terms:
            gap_s = gap_s if kept else 0.0
            kept.append(replace(phase, terms=terms, max_s=float("inf"), gap_s=gap_s))
            gap_s = 0.0
        else:
            gap_s += phase.max_s
    if not kept:
        return None
    return replace(activity, phases=tuple(kept), relations=())


def in_pixels(stage: Stage, metres_per_px: float) -> Stage:
    """The stage with the image as ground: x to the right, y up, positions at the feet of the boxes.

    One factor turns pixels into metres everywhere, so that the same activities can be searched
    for. Velocities are slopes over :data:`_WINDOW_S`, headings those of the motion (the last one
    where somebody stands), errors :data:`NOISE_SHARE` of the box. Rows without a box are NaN.
    Raises :class:`InputError` where the factor is not positive.
    """
    if not metres_per_px > 0:
        raise InputError(f"metres_per_px must be positive, found {metres_per_px}")
    return _in_image(stage, np.full(len(stage.tracks), metres_per_px))


def in_box_sizes(stage: Stage, box_m: float) -> Stage:
    """As :func:`in_pixels`, where each box, the root of its area, is ``box_m`` long: things move by
    their own sizes, which needs no camera. Positions of two of them cannot be compared.
    """
    size = np.clip(stage.tracks.box_xyxy[:, 2:] - stage.tracks.box_xyxy[:, :2], 1.0, None)
    return _in_image(stage, box_m / np.sqrt(size.prod(axis=1)))


def track_ends(
    stage: Stage, classes: Sequence[str], length_s: float, at_end: bool
) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t"], Int[np.ndarray, "t"]]:
    """What one finds who knows nothing but when tracks end (or begin): one event of ``length_s``
    there per track of the classes, the shorter the track the better; spans, scores, tracks.
    """
    first, last = stage.first_row, stage.last_row
    mine = np.isin(stage.tracks.class_name[first], classes)
    begin_s, end_s = (stage.tracks.time_s[rows[mine]] for rows in (first, last))
    begin = end_s - length_s if at_end else begin_s
    spans = np.column_stack([begin, begin + length_s])
    return spans, 1 / (1 + end_s - begin_s), stage.tracks.track[first[mine]]


def _in_image(stage: Stage, metres_per_px: Float[np.ndarray, "n"]) -> Stage:
    tracks = stage.tracks
    box = tracks.box_xyxy
    uv = np.column_stack([(box[:, 0] + box[:, 2]) / 2, -box[:, 3]])
    variance = (NOISE_SHARE * metres_per_px * (box[:, 3] - box[:, 1])) ** 2
    slope, spread = _slopes(stage, uv)
    velocity = slope * metres_per_px[:, None]
    own = variance[:, None, None] * np.eye(2)
    moved = replace(
        tracks,
        xy_m=uv * metres_per_px[:, None],
        covariance_m2=own,
        shared_covariance_m2=np.zeros_like(own),
        velocity_mps=velocity,
        velocity_covariance=own * spread[:, None, None],
        **_headings(velocity, np.sqrt(variance * spread), stage.track_of_row),
    )
    return replace(stage, tracks=moved, camera_factor=None, camera=None)


def _slopes(
    stage: Stage, xy: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """Slope of a straight line through the rows of the same track within half a window, and its
    variance for positions of variance 1; NaN where that is one row.
    """
    early, late = stage.window(np.arange(len(xy)), _WINDOW_S / 2)
    begin, end = early, late + 1
    origin = stage.first_row[stage.track_of_row]
    time_s = stage.tracks.time_s
    seen = np.isfinite(xy).all(axis=1)
    t = np.where(seen, time_s - time_s[origin], 0.0)
    p = np.where(seen[:, None], xy - np.nan_to_num(xy[origin]), 0.0)

    def total(values: np.ndarray) -> np.ndarray:
        sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
        return np.asarray(sums[end] - sums[begin])

    count, sum_t, sum_tt = total(np.column_stack([seen, t, t * t])).T
    sum_p, sum_tp = total(p), total(t[:, None] * p)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = sum_t / count
        spread = sum_tt - count * middle**2
        slope = (sum_tp - middle[:, None] * sum_p) / spread[:, None]
        variance = 1 / spread
    known = seen & (count > 1) & (spread > 1e-9)
    return np.where(known[:, None], slope, np.nan), np.where(known, variance, np.nan)


def _headings(
    velocity: Float[np.ndarray, "n 2"], sigma: Float[np.ndarray, "n"], track: Int[np.ndarray, "n"]
) -> dict[str, np.ndarray]:
    """Heading of the motion; where there is none, that of the last motion, else of the next."""
    speed = np.hypot(*velocity.T)
    moving = np.flatnonzero(speed > _SLOW_SIGMAS * sigma)
    heading, heading_sigma = np.full((2, len(track)), np.nan)
    if len(moving):
        last = np.searchsorted(moving, np.arange(len(track)), side="right") - 1
        before = moving[np.maximum(last, 0)]
        after = moving[np.minimum(last + 1, len(moving) - 1)]
        held = (last >= 0) & (track[before] == track)
        source = np.where(held, before, after)
        known = track[source] == track
        rows = source[known]
        heading[known] = np.arctan2(velocity[rows, 1], velocity[rows, 0])
        heading_sigma[known] = sigma[rows] / speed[rows]
    return {"heading_rad": heading, "heading_sigma_rad": heading_sigma}
