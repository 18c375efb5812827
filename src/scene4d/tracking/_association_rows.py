"""The detections of a frame and the tracks held, as arrays that the association works on."""

from dataclasses import dataclass

import numpy as np

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._motion_model import SPEED, class_numbers


@dataclass(frozen=True, eq=False)
class Seen:
    """Detections of one frame; ``colour`` is NaN where unknown."""

    kind: np.ndarray  # (n,) class number
    known: np.ndarray  # (n,) has a ground point
    xy: np.ndarray  # (n, 2)
    covariance: np.ndarray  # (n, 2, 2)
    foot: np.ndarray  # (n, 2) px
    height: np.ndarray  # (n,) px
    colour: np.ndarray  # (n, d)


@dataclass(frozen=True, eq=False)
class Held(Columns):
    label: np.ndarray  # (t,)
    kind: np.ndarray  # (t,) class number when last seen
    born_s: np.ndarray
    seen_s: np.ndarray
    known: np.ndarray  # (t,) has ever had a ground point
    located_s: np.ndarray  # (t,) time of the state
    state: np.ndarray  # (t, 4) position, velocity
    covariance: np.ndarray  # (t, 4, 4)
    mean_xy: np.ndarray  # (t, 2) averaged over the last seconds
    foot: np.ndarray
    drift: np.ndarray  # (t, 2) px per second
    height: np.ndarray
    colour: np.ndarray


def seen_rows(d: Detections, located: Located, appearance: np.ndarray | None) -> Seen:
    n = len(d)
    if len(located) != n or (appearance is not None and len(appearance) != n):
        rows = n if appearance is None else len(appearance)
        raise InputError(
            f"tracker: found {n} detections, {len(located)} located rows and {rows} rows of "
            "appearance, expected as many of each"
        )
    box = d.box_xyxy
    empty = ~(np.isfinite(box).all(axis=1) & (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1]))
    if empty.any():
        row = int(np.flatnonzero(empty)[0])
        raise InputError(
            f"tracker: box of row {row} must be x1 < x2, y1 < y2, found {box[row].tolist()}"
        )
    known = located.known
    return Seen(
        kind=class_numbers(d.class_name),
        known=known,
        xy=np.where(known[:, None], located.xy_m, 0.0),
        covariance=np.where(known[:, None, None], located.covariance_m2, np.eye(2)),
        foot=d.box_foot_uv,
        height=box[:, 3] - box[:, 1],
        colour=np.full((n, 1), np.nan) if appearance is None else appearance,
    )


def nothing() -> Seen:
    none, pairs = np.empty(0), np.empty((0, 2))
    kind, known = np.empty(0, np.int64), np.empty(0, bool)
    return Seen(kind, known, pairs, np.empty((0, 2, 2)), pairs, none, np.empty((0, 1)))


def started(seen: Seen, rows: np.ndarray, time_s: float) -> Held:
    n, kind = len(rows), seen.kind[rows]
    covariance = np.zeros((n, 4, 4))
    covariance[:, :2, :2] = seen.covariance[rows]
    covariance[:, [2, 3], [2, 3]] = SPEED[kind][:, None] ** 2
    now = np.full(n, time_s)
    return Held(
        label=np.zeros(n, np.int64),
        kind=kind,
        born_s=now,
        seen_s=now.copy(),
        known=seen.known[rows],
        located_s=now.copy(),
        state=np.concatenate([seen.xy[rows], np.zeros((n, 2))], axis=1),
        covariance=covariance,
        mean_xy=seen.xy[rows].copy(),
        foot=seen.foot[rows],
        drift=np.zeros((n, 2)),
        height=seen.height[rows],
        colour=seen.colour[rows],
    )
