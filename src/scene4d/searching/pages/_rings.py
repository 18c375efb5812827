"""The ring in which things are near, in the picture: figure 1 of Wagner et al. (2019)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core.calibration import Calibration
from scene4d.searching.activities._terms import value_of
from scene4d.searching.activities.definition import Activity, Term
from scene4d.searching.predicates._distance import near
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent
from scene4d.searching.stages import stage_of

_TURN = np.linspace(0, 2 * np.pi, 97)
_CROSS_M = 0.25 * np.array([[[-1.0, -1], [1, 1]], [[-1, 1], [1, -1]]])
"""The mark in the middle of a spot."""
_LEAST = 0.05
"""Who is near with less than this is outside without a number, unless it takes part."""


@dataclass(frozen=True, eq=False)
class Ring:
    """At one frame: the outline (k, 2) in pixels around a ``role``, NaN where it is not visible,
    and P(near) of those about it, with the pixels of their feet.
    """

    role: str
    outline_uv: Float[np.ndarray, "k 2"]
    feet_uv: Float[np.ndarray, "n 2"]
    probability: Float[np.ndarray, "n"]


class Rings:
    """The rings of an event: one for each role that another one has to be near to, and one for
    each spot where somebody else was.
    """

    def __init__(self, found: FoundEvent, activity: Activity, calibration: Calibration) -> None:
        self._found, self._calibration = found, calibration
        self._terms = {t.roles[1]: t for t in activity.terms if t.predicate == "near"}
        self._terms = {role: t for role, t in self._terms.items() if not t.negated}
        self._stage: Stage | None = None
        known = bool(self._terms) and calibration.camera is not None
        if known and found.around is not None:
            self._stage = stage_of(found.around, calibration)

    def at(self, frame: int) -> Iterator[Ring]:
        """The rings at a frame of the footage; none for a role that is not tracked at it."""
        for role, term in self._terms.items():
            ring = None if self._stage is None else self._ring(self._stage, role, term, frame)
            if ring is not None:
                yield ring
        for spot in self._found.spots if self._calibration.camera is not None else ():
            middle, gap = np.array(spot.xy_m), np.full((1, 2), np.nan)
            around = _circle(middle, spot.tau_m)
            outline = np.vstack([around, gap, middle + _CROSS_M[0], gap, middle + _CROSS_M[1]])
            yield Ring(spot.role, self._seen(outline), np.zeros((0, 2)), np.zeros(0))

    def _ring(self, stage: Stage, role: str, term: Term, frame: int) -> Ring | None:
        tracks = stage.tracks
        here = _rows_at(stage, frame)
        about = here[tracks.track[here] == self._found.event.roles[role]]
        if len(about) == 0 or not np.isfinite(tracks.xy_m[about[0]]).all():
            return None
        like = self._found.event.roles[term.roles[0]]
        kind = tracks.class_name[tracks.track == like][:1]
        others = here[(tracks.track[here] != tracks.track[about[0]])]
        others = others[(tracks.class_name[others] == kind) | (tracks.track[others] == like)]
        others = others[np.isfinite(tracks.xy_m[others]).all(axis=1)]
        middle = np.repeat(about[:1], len(others))
        tau_m, sigma_m = (value_of(term, name) for name in ("tau_m", "sigma_m"))
        p = near(stage.rows(others), stage.rows(middle), tau_m=tau_m, sigma_m=sigma_m)
        told = (p >= _LEAST) | (tracks.track[others] == like)
        circle = _circle(tracks.xy_m[about[0]], tau_m)
        return Ring(role, self._seen(circle), self._seen(tracks.xy_m[others[told]]), p[told])

    def _seen(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        known = np.isfinite(xy_m).all(axis=1)
        uv, visible = self._calibration.ground_pixels(np.where(known[:, None], xy_m, 0.0))
        visible &= known
        return np.where(visible[:, None], uv, np.nan)


def _circle(middle: Float[np.ndarray, "2"], radius_m: float) -> Float[np.ndarray, "k 2"]:
    return middle + radius_m * np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


def _rows_at(stage: Stage, frame: int) -> np.ndarray:
    """The row of each track that is nearest to a frame, where one is within a step of it."""
    frames = stage.tracks.frame
    gaps = np.abs(frames - frame)
    times = np.unique(frames)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    rows = np.flatnonzero(gaps <= step)
    nearest = rows[np.lexsort([gaps[rows], stage.track_of_row[rows]])]
    return nearest[np.diff(stage.track_of_row[nearest], prepend=-1) > 0]
