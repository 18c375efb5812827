"""Where a site lies on a map, from lines that tracks keep to: roads, pavements, crossings.

Every heading (in steps) and every shift are tried at once: ways and lines are drawn on one grid, by
direction, and correlated. The best of them are moved to their optimum by Gauss-Newton over shift,
heading, scale (with its prior) and how far to the right of a line all keep. A track keeps its
distance from a line along its whole way, so a long straight way is one fact of where the line is
and not many. What no line is near loses its weight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.fft import irfft2, rfft2
from scipy.ndimage import distance_transform_edt, maximum_filter
from scipy.spatial import cKDTree

from scene4d.alignment._score import Fit, different
from scene4d.core.columns import Columns
from scene4d.core.placement import Placement
from scene4d.core.tracks import VEHICLES, Tracks
from scene4d.formats.anchors import MapLine

SCALE_SIGMA = 0.05
"""Log-scale of the site's metre against the true one: what the mean height of people tells."""
_EVERY_M, _MOST_WAY = 1.0, 3_000
"""Ways are looked at so often, and at so many places of the longest tracks at most."""
_FACT_M = 5.0
"""After so far (m) a track's noise about its own distance from a line is new."""
_KEPT_M, _SIDE_M, _NOISE_M = 1.2, 2.0, 0.5
"""Standard deviations (m) of what one track keeps from a line along its way, of what all keep to
the right of it, and of the noise of a fact. Chosen: lanes are 3 m wide, and a map may have one line
for both."""
_MAP_M = 1.0
"""How far off the lines of a map are as a whole (m): they are read off aerial photographs."""
_ON_LINE = 20.0
"""How much likelier a way lies right on a line than anywhere. Chosen."""
_ASKEW = np.radians(35.0)
"""A way at a larger angle to a line does not follow it."""
_TURN_M = 6.0
"""Distance (m) that counts as much as one radian between the directions of way and line."""
_BINS, _HEADINGS, _MOST_CELLS, _CELL_M = 8, 72, 384, 1.5
_PEAKS, _MOVED = 3, 16
"""Best shifts for each heading, and how many of all are moved to their optimum."""
_THINNED = 500
_STEPS = 15
_HELD = 1e-8
"""Information that keeps what nothing tells where it is."""
_APART = 4.0
"""Places of :func:`different` so far apart, in its 1.5 m, are two."""
_MARGIN, _SHARE = 5.0, 0.1
"""Log-ratio by which a place must beat others, and the same as a share of its own."""
_FOLLOWED = 0.5
"""Share of the ways that must lie on lines."""
_MOST_SIGMA_M, _MOST_SIGMA_RAD = 4.0, np.radians(10.0)
"""What must be determined where people are; a place is told from the next road by it."""


@dataclass(frozen=True, eq=False)
class _Ways(Columns):
    """Places along tracks, a metre apart, by track: where, which way, whose, and how the cameras'
    common errors move them (``modes_m``: columns of one standard deviation each).
    """

    xy_m: Float[np.ndarray, "n 2"]
    ahead: Float[np.ndarray, "n 2"]
    track: Int[np.ndarray, "n"]
    kind: Int[np.ndarray, "n"]
    modes_m: Float[np.ndarray, "n 2 r"]


def on_lines(
    tracks: Sequence[Tracks],
    modes_m: Sequence[Float[np.ndarray, "_n 2 r"]],
    lines: Sequence[MapLine],
) -> Placement:
    """The frame of these tracks in that of the lines; undetermined, with the reason, where tracks
    do not tell it. ``modes_m`` is how each row moves with every error that rows share: a column for
    each, of one standard deviation.
    """
    ways = _ways(tracks, modes_m)
    maps = {kind: _Map.of(lines, kind) for kind in np.unique(ways.kind).tolist()}
    ways = ways.select(np.array([maps[kind].known for kind in ways.kind.tolist()], bool))
    if not len(ways.xy_m):
        return Placement.undetermined("nobody walks or drives who keeps to the lines of the map")
    starts = _starts(ways, maps)
    few = ways.select(_spread_out(len(ways.xy_m), _THINNED))
    moved = different([_moved(few, maps, one) for one in starts], ways.xy_m, _APART)
    found = [_moved(ways, maps, one) for one in moved[:3]]
    found = different(found, ways.xy_m, _APART)
    best = _Solved.at(ways, maps, found[0].parameters)
    reason = best.untold(ways) or _rivalled(best, found)
    return Placement.undetermined(reason) if reason else best.placement()


def _ways(tracks: Sequence[Tracks], modes_m: Sequence[np.ndarray]) -> _Ways:
    """Rows of tracks a metre of way apart, of the longest tracks first."""
    parts, number = [], 0
    for seen, modes in zip(tracks, modes_m, strict=True):
        known = np.flatnonzero(np.isfinite(seen.xy_m).all(axis=1))
        xy, track = seen.xy_m[known], seen.track[known]
        for rows in np.split(np.arange(len(known)), np.flatnonzero(np.diff(track)) + 1):
            kept = _metre_by_metre(xy[rows])
            if len(kept) < 3:
                continue
            rows = rows[kept]
            step = np.gradient(xy[rows], axis=0)
            ahead = step / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
            kind = int(seen.class_name[known[rows[0]]] in VEHICLES)
            whole = np.full(len(rows), number), np.full(len(rows), kind)
            parts.append(_Ways(xy[rows], ahead, *whole, modes[known[rows]]))
            number += 1
    parts.sort(key=lambda one: -len(one.xy_m))
    most = int(np.searchsorted(np.cumsum([len(one.xy_m) for one in parts]), _MOST_WAY)) + 1
    if not parts:
        nobody = np.zeros(0, int)
        return _Ways(np.zeros((0, 2)), np.zeros((0, 2)), nobody, nobody, np.zeros((0, 2, 0)))
    return _Ways.joined(parts[:most])


def _metre_by_metre(xy: np.ndarray) -> list[int]:
    """Rows at which a track has gone a metre since the one before: who stands tells nothing."""
    kept = [0] if len(xy) else []
    for row, here in enumerate(xy):
        if np.hypot(*(here - xy[kept[-1]])) >= _EVERY_M:
            kept.append(row)
    return kept


def _spread_out(n: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))


class _Map:
    """Lines as points, a metre apart, with their directions; looked up by place and direction."""

    def __init__(self, xy_m: np.ndarray, along: np.ndarray) -> None:
        self.xy_m, self.along, self.known = xy_m, along, len(xy_m) > 0
        self._tree = cKDTree(self._key(xy_m, along)) if self.known else None

    @classmethod
    def of(cls, lines: Sequence[MapLine], kind: int) -> "_Map":
        """The lines of a kind."""
        xy, along = [np.zeros((0, 2))], [np.zeros((0, 2))]
        for line in lines:
            for a, b in zip(line.xy_m[:-1], line.xy_m[1:], strict=True):
                length = float(np.hypot(*(b - a)))
                if kind in line.kinds and length > 0:
                    n = max(2, int(np.ceil(length / _EVERY_M)) + 1)
                    xy.append(a + np.linspace(0, 1, n)[:, None] * (b - a))
                    along.append(np.tile((b - a) / length, (n, 1)))
        return cls(np.concatenate(xy), np.concatenate(along))

    def nearest(
        self, xy: Float[np.ndarray, "n 2"], ahead: Float[np.ndarray, "n 2"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For places and directions the left normal of the line there, seen along the way, the
        distance to the left of it, and the whole distance (infinite without a line that way).
        """
        assert self._tree is not None
        _, row = self._tree.query(self._key(xy, ahead))
        along = self.along[row]
        cosine = (along * ahead).sum(axis=1)
        along = along * np.where(cosine < 0, -1.0, 1.0)[:, None]
        normal = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        step = xy - self.xy_m[row]
        left, past = (step * normal).sum(axis=1), np.abs((step * along).sum(axis=1))
        whole = np.hypot(left, np.maximum(past - _EVERY_M, 0.0))
        askew = np.abs(cosine) < np.cos(_ASKEW)
        return normal, left, np.where(askew, np.inf, whole)

    @staticmethod
    def _key(xy: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Direction without sense: as a point on a circle at twice its angle."""
        double = 2 * np.arctan2(along[:, 1], along[:, 0])
        circle = np.column_stack([np.cos(double), np.sin(double)])
        return np.column_stack([xy, _TURN_M / 2 * circle])


_Maps = dict[int, _Map]


def _starts(ways: _Ways, maps: _Maps) -> list[Fit]:
    """The best shifts of every heading, over the whole map: correlations on one grid."""
    middle = ways.xy_m.mean(axis=0)
    there = ways.xy_m - middle
    reach = float(np.hypot(*there.T).max())
    points = np.concatenate([one.xy_m for one in maps.values()])
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    cell = max(_CELL_M, float((high - low).max()) / _MOST_CELLS)
    size = tuple((np.ceil((high - low) / cell).astype(int) + 1).tolist())
    near = {
        (kind, number): rfft2(layer)
        for kind, one in maps.items()
        if one.known
        for number, layer in enumerate(_layers(one, low, cell, size))
    }
    found: list[Fit] = []
    for heading in np.arange(_HEADINGS) * 2 * np.pi / _HEADINGS:
        c, s = np.cos(heading), np.sin(heading)
        turn = np.array([[c, -s], [s, c]])
        at = np.rint(there @ turn.T / cell).astype(int) % size
        total = np.zeros((size[0], size[1] // 2 + 1), np.complex64)
        layer = _bin(ways.ahead @ turn.T)
        for (kind, number), lines in near.items():
            rows = at[(ways.kind == kind) & (layer == number)]
            if len(rows):
                drawn = np.zeros(size, np.float32)
                np.add.at(drawn, tuple(rows.T), 1.0)
                total += lines * rfft2(drawn).conj()
        score = irfft2(total, size)
        peaks = np.flatnonzero((score > 0) & (score == maximum_filter(score, 5, mode="wrap")))
        for flat in peaks[np.argsort(-score.flat[peaks])][:_PEAKS]:
            cells = np.array(np.unravel_index(flat, size))
            shift = low + cell * cells - turn @ middle
            values = np.array([*shift, heading, 0.0, 0.0])
            found.append(Fit(values, float(score.flat[flat])))
    return different(found, ways.xy_m)[:_MOVED]


def _bin(along: np.ndarray) -> np.ndarray:
    """Number of the direction, without sense."""
    angle = np.arctan2(along[:, 1], along[:, 0]) % np.pi
    number: np.ndarray = np.rint(angle * _BINS / np.pi).astype(int) % _BINS
    return number


def _layers(one: _Map, low: np.ndarray, cell: float, size: tuple[int, int]) -> list[np.ndarray]:
    """How near each cell is to a line (0 to 1), by direction; neighbouring directions count."""
    number = _bin(one.along)
    cells = tuple(np.rint((one.xy_m - low) / cell).astype(int).T)
    wide = max(2.0 * _KEPT_M, 1.5 * cell)
    found = []
    for k in range(_BINS):
        away = np.abs((number - k + _BINS // 2) % _BINS - _BINS // 2) <= 1
        free = np.ones(size, bool)
        free[tuple(axis[away] for axis in cells)] = False
        far = distance_transform_edt(free) * cell if away.any() else np.full(size, np.inf)
        found.append(np.exp(-((far / wide) ** 2) / 2).astype(np.float32))
    return found


@dataclass(frozen=True, eq=False)
class _Solved:
    """The equations at a place: for shift, heading, log-scale and side (5) and for the cameras'
    common errors the information, and the force; the log-ratio, and how much lies on lines.
    """

    parameters: Float[np.ndarray, "5"]
    information: Float[np.ndarray, "k k"]
    force: Float[np.ndarray, "5"]
    score: float
    followed: float
    noise: float

    @classmethod
    def at(cls, ways: _Ways, maps: _Maps, parameters: np.ndarray, whole: bool = True) -> "_Solved":
        """At shift, heading, log-scale and side."""
        frame = _placed(parameters)
        xy, ahead = frame.points(ways.xy_m), frame.velocities(ways.ahead) / frame.scale
        normal, left, far = (np.zeros((len(xy), 2)), np.zeros(len(xy)), np.full(len(xy), np.inf))
        for kind in np.unique(ways.kind).tolist():
            rows = ways.kind == kind
            normal[rows], left[rows], far[rows] = maps[kind].nearest(xy[rows], ahead[rows])
        side = left + parameters[4]
        spread = _KEPT_M**2 + _NOISE_M**2
        near = _ON_LINE * np.exp(
            -(side**2 + np.where(np.isfinite(far), far**2 - left**2, np.inf)) / (2 * spread)
        )
        weight = near / (1 + near)
        fact = _EVERY_M / _FACT_M
        columns = np.zeros((len(xy), 5))
        # Derivatives are taken on the line: at noisy places, noise would reward a small scale.
        feet = frame.inverse().points(xy - left[:, None] * normal)
        columns[:, :4] = np.einsum("ni,nia->na", normal, frame.point_jacobian(feet)[:, :, :4])
        columns[:, 4] = 1.0
        modes = np.einsum("ni,ij,njr->nr", normal, frame.linear, ways.modes_m) if whole else None
        parts = [columns, *([] if modes is None else [modes]), side[:, None]]
        normal_of = _by_track(np.hstack(parts), weight * fact / _NOISE_M**2, ways.track)
        prior = np.array([0.0, 0.0, 0.0, SCALE_SIGMA**-2, _SIDE_M**-2])
        information = normal_of[:-1, :-1].copy()
        information[np.diag_indices(5)] += prior + _HELD
        force = -normal_of[:5, -1] - prior * parameters
        facts = max(float(weight.sum()) * fact, 1.0)
        score = float(fact * np.log1p(near).sum() - (prior * parameters**2).sum() / 2)
        noise = max(1.0, float(normal_of[-1, -1]) / facts)
        return cls(parameters, information, force, score, float(weight.mean()), noise)

    def covariance(self) -> Float[np.ndarray, "5 5"]:
        """Of the five, with what the cameras' common errors move."""
        inverse = np.linalg.inv(self.information[:5, :5])
        moved = inverse @ self.information[:5, 5:]
        return self.noise * inverse + moved @ moved.T

    def untold(self, ways: _Ways) -> str | None:
        """What the lines leave open, if so."""
        if self.followed < _FOLLOWED:
            return (
                f"no more than {self.followed * 100:.0f} % of the ways lie along lines of the map "
                "wherever the site is put; are these the right lines, and enough of them?"
            )
        covariance, middle = self.covariance(), ways.xy_m.mean(axis=0)
        slopes = _placed(self.parameters).point_jacobian(middle[None])[0, :, :4]
        size, axes = np.linalg.eigh(slopes @ covariance[:4, :4] @ slopes.T)
        turn = float(np.sqrt(covariance[2, 2]))
        if size[1] > _MOST_SIGMA_M**2:
            degrees = np.degrees(np.arctan2(axes[1, 1], axes[0, 1])) % 180
            return (
                f"the site slides along the lines (±{np.sqrt(size[1]):.0f} m at {degrees:.0f}° "
                "from east): who keeps to them goes one way; add lines across that tracks follow"
            )
        if turn > _MOST_SIGMA_RAD:
            return f"the heading is not determined (±{np.degrees(turn):.0f}°) by the lines"
        return None

    def placement(self) -> Placement:
        """With what the map is off by."""
        covariance = self.covariance()[:4, :4]
        covariance[[0, 1], [0, 1]] += _MAP_M**2
        return _placed(self.parameters, covariance)


def _placed(parameters: Float[np.ndarray, "5"], covariance: np.ndarray | float = 0.0) -> Placement:
    """Shift, heading and log-scale as a placement: lines tell nothing of the clock."""
    whole = np.zeros((5, 5))
    whole[:4, :4] = covariance
    return Placement.from_parameters(np.append(parameters[:4], 0.0), whole)


def _by_track(columns: np.ndarray, weight: np.ndarray, track: np.ndarray) -> np.ndarray:
    """``Xᵀ C⁻¹ X`` where the errors of a track are noise and one distance that it keeps."""
    found = columns.T @ (weight[:, None] * columns)
    _, of = np.unique(track, return_inverse=True)
    sums = np.zeros((of.max() + 1, columns.shape[1]))
    np.add.at(sums, of, weight[:, None] * columns)
    total = np.bincount(of, weight)
    common: np.ndarray = sums.T @ (sums * (_KEPT_M**2 / (1 + _KEPT_M**2 * total))[:, None])
    return found - common


def _moved(ways: _Ways, maps: _Maps, start: Fit) -> Fit:
    """The nearest optimum, with its log-ratio."""
    at = start.parameters.copy()
    for _ in range(_STEPS):
        here = _Solved.at(ways, maps, at, whole=False)
        step = np.linalg.solve(here.information, here.force)
        step[2] = np.clip(step[2], -0.2, 0.2)
        at = at + step
        if np.abs(step[:3]).max() < 1e-3:
            break
    return Fit(at, _Solved.at(ways, maps, at, whole=False).score)


def _rivalled(best: _Solved, found: Sequence[Fit]) -> str | None:
    """Another place that fits nearly as well, if there is one."""
    if len(found) < 2 or found[1].score < best.score - max(_MARGIN, _SHARE * best.score):
        return None
    turn = np.degrees(found[1].parameters[2] - best.parameters[2])
    turn = abs((turn + 180) % 360 - 180)
    away = np.hypot(*(found[1].parameters[:2] - best.parameters[:2]))
    how = f"turned by {turn:.0f}°" if turn > 15 else f"{away:.0f} m away"
    return f"the tracks keep to the lines as well {how}; add lines that tell the two apart"
