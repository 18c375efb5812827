"""Two tracks of one vehicle: a car and a truck, say, where a detector sees a pick-up as both.

Two vehicles cannot stand on the same ground. Where the outlines on the ground of two tracks that
are seen at once overlap for long, they are one: the younger becomes a double of the elder. A double
is seen (it keeps its number, which is not published) while the elder is, and takes its place, with
its number, while the elder is not.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logit, ndtr

from scene4d.core.tracks import Located
from scene4d.core.vehicle_shapes import SHAPES
from scene4d.tracking._motion_model import LASTING_S

_NEAR_M = 8.0
"""Vehicles further apart are not compared: half the lengths of a bus and a lorry."""
_PRIOR = -2.0
"""Log odds that two vehicles seen at once are one, before looking where they are: a detector's
overlapping boxes have been thinned already. Chosen by hand, like the limits."""
_ONE, _TWO = 3.0, -1.0
"""Log odds from which two tracks are one (20 to 1), and below which they are two again."""
_MOST = 6.0
"""Limit of the log odds, so that two vehicles that part are told apart within seconds."""
_LEAST = 0.02
"""No single comparison is more certain than this."""
_AXIS_SIGMA = 0.3
"""Radians: a heading less certain than this does not tell how far a vehicle reaches."""
_FORGET_S = 600.0
"""A pair is forgotten when not seen at once for so long."""


@dataclass
class _Pair:
    log_odds: float
    seen_s: float


class Doubles:
    """Finds doubles among the tracks of successive frames; streaming."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[int, int], _Pair] = {}
        self._elder: dict[int, int] = {}

    def update(
        self,
        time_s: float,
        track: Int[np.ndarray, "n"],
        class_name: np.ndarray,
        located: Located,
    ) -> Int[np.ndarray, "n"]:
        """The track numbers of a frame; a double that is seen alone has its elder's."""
        rows = np.flatnonzero(np.isin(class_name, list(_WIDE)) & located.known)
        for i, a in enumerate(rows.tolist()):
            for b in rows[i + 1 :].tolist():
                if np.hypot(*(located.xy_m[a] - located.xy_m[b])) <= _NEAR_M:
                    self._compare(time_s, track, class_name, located, a, b)
        self._forget(time_s)
        there = set(track.tolist())
        out = track.copy()
        for row in np.argsort(track, kind="stable"):
            elder = self._elder_of(int(track[row]))
            if elder not in there:
                out[row] = elder
                there.add(elder)
        return out

    def among(self, track: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
        """Which of these tracks are doubles."""
        return np.isin(track, list(self._elder))

    def _elder_of(self, track: int) -> int:
        while track in self._elder:
            track = self._elder[track]
        return track

    def _compare(
        self,
        time_s: float,
        track: np.ndarray,
        class_name: np.ndarray,
        located: Located,
        a: int,
        b: int,
    ) -> None:
        elder, younger = sorted((int(track[a]), int(track[b])))
        pair = self._pairs.setdefault((elder, younger), _Pair(_PRIOR, time_s))
        p = _overlap(class_name[[a, b]], located.select(np.array([a, b])))
        share = min(1.0, (time_s - pair.seen_s) / LASTING_S)
        told = share * float(logit(np.clip(p, _LEAST, 1 - _LEAST)))
        pair.log_odds = float(np.clip(pair.log_odds + told, -_MOST, _MOST))
        pair.seen_s = time_s
        if pair.log_odds > _ONE and self._elder_of(elder) != younger:
            self._elder[younger] = elder
        elif pair.log_odds < _TWO and self._elder.get(younger) == elder:
            del self._elder[younger]

    def _forget(self, time_s: float) -> None:
        old = [key for key, pair in self._pairs.items() if time_s - pair.seen_s > _FORGET_S]
        for key in old:
            del self._pairs[key]
            if self._elder.get(key[1]) == key[0]:
                del self._elder[key[1]]


_WIDE = {n: tuple(SHAPES[n].size_m[:2] / 2) for n in ("car", "truck", "bus", "vehicle")}
"""Half length and half width by class. Two-wheelers stand closer than their positions are known."""


def _overlap(class_name: np.ndarray, located: Located) -> float:
    """Probability that the ground outlines of two vehicles overlap."""
    way = located.xy_m[1] - located.xy_m[0]
    distance = float(np.hypot(*way))
    along = way / distance if distance > 0 else np.array([1.0, 0.0])
    covariance: Float[np.ndarray, "2 2"] = located.covariance_m2.sum(axis=0)
    sigma = float(np.sqrt(along @ covariance @ along))
    reach = sum(
        _reach(name, heading, spread, along)
        for name, heading, spread in zip(
            class_name, located.heading_rad, located.heading_sigma_rad, strict=True
        )
    )
    return float(ndtr((reach - distance) / sigma))


def _reach(name: str, heading: float, sigma: float, along: np.ndarray) -> float:
    """How far a vehicle surely reaches from its middle: half its width, or more lengthwise."""
    length, width = _WIDE[name]
    if not sigma < _AXIS_SIGMA:
        return float(width)
    cos = abs(np.cos(heading) * along[0] + np.sin(heading) * along[1])
    sin = np.sqrt(max(0.0, 1 - cos**2))
    return float(min(length / max(cos, 1e-9), width / max(sin, 1e-9)))
