"""Who is seen through a vehicle's windows, and rides along in it; and whether it drives off."""

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.boxes import covered
from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates._meeting import expand
from scene4d.searching.predicates.stage import Stage

# Chosen by hand: a parked vehicle's place is that exact, and heads stay within the windows.
_MOVED_M, _MOVED_SIGMA_M = 2.0, 0.5
_DRIVES_S = 20.0
_DRIVES_OFF, _ARRIVES = (0.17, 0.10), (0.33, 0.12)
"""P(a vehicle that stands drives off within 20 s) after somebody got in, and after somebody's track
ended within its outline otherwise; P(it arrived within 20 s) before somebody got out, and else.
Counted on the tuning cameras (MEVA G341 and G424): 60 and 115 ends, 85 and 110 begins. People are
annotated there because they do things with cars: elsewhere others' cars drive off more rarely."""
_WITHIN_SHARE, _WITHIN_SIGMA = 0.7, 0.15


def within(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """P(what has so large a share of its box covered by a vehicle's is inside its outline)."""
    return ndtr((share - _WITHIN_SHARE) / _WITHIN_SIGMA)


def riding(
    stage: Stage, track: Int[np.ndarray, " p"], vehicle: Int[np.ndarray, "p"]
) -> Float[np.ndarray, " p"]:
    """P(a track is somebody inside a vehicle) of pairs of tracks, by their positions in the stage:
    the mean of ``Φ((share - 0.7) / 0.15)`` of the shares of its boxes that the vehicle's cover, if
    that moved by more than 2 ± 0.5 m meanwhile. Whoever walks about is left behind. 0 for -1.
    """
    out = np.zeros(len(track))
    pairs = np.flatnonzero((vehicle >= 0) & (vehicle != track))
    first = stage.first_row[track[pairs]]
    owner, rows = expand(first, stage.last_row[track[pairs]] - first + 1)
    beside = stage.row_at(vehicle[pairs][owner], stage.tick[rows])
    box = stage.tracks.box_xyxy
    seen = (beside >= 0) & np.isfinite(box[rows]).all(axis=1) & np.isfinite(box[beside]).all(axis=1)
    owner, rows, beside = owner[seen], rows[seen], beside[seen]
    if not len(owner):
        return out
    count = np.bincount(owner, minlength=len(pairs))
    total = np.bincount(owner, within(covered(box[rows], box[beside])), len(pairs))
    begin = np.flatnonzero(np.diff(owner, prepend=-1))
    end = np.append(begin[1:], len(owner)) - 1
    way = stage.tracks.xy_m[beside[end]] - stage.tracks.xy_m[beside[begin]]
    moved = ndtr((np.linalg.norm(way, axis=1) - _MOVED_M) / _MOVED_SIGMA_M)
    out[pairs[owner[begin]]] = np.nan_to_num(moved) * total[owner[begin]] / count[owner[begin]]
    return out


def drives_ratio(
    stage: Stage,
    vehicle: Int[np.ndarray, " p"],
    time_s: Float[np.ndarray, " p"],
    last: bool,
) -> Float[np.ndarray, " p"]:
    """How much likelier what vehicles do in the 20 s after some moments is if somebody got in then
    (``last`` False: what they did before, if somebody got out); 1 as far as nothing is known.
    """
    xy_m, line = stage.tracks.xy_m, stage.line_s
    at = stage.on_line(vehicle, time_s)
    now = np.clip(np.searchsorted(line, at), stage.first_row[vehicle], stage.last_row[vehicle])
    early, late = stage.window(now, _DRIVES_S)
    then = late if last else early
    way_m = np.linalg.norm(xy_m[then] - xy_m[now], axis=1)
    moved = np.nan_to_num(ndtr((way_m - _MOVED_M) / _MOVED_SIGMA_M))
    inside, outside = _DRIVES_OFF if last else _ARRIVES
    watched = np.abs(stage.tracks.time_s[then] - time_s) >= _DRIVES_S - stage.step_s
    stayed = np.where(watched, (1 - inside) / (1 - outside), 1.0)
    return np.asarray(moved * inside / outside + (1 - moved) * stayed)
