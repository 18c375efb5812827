"""What moving vehicles say about the camera: cuboids of known classes fill their boxes.

A vehicle stands on the ground, heads where it moves, and has a length, width and height drawn from
its class. Its image has a bounding box with four edges; each is the projection of one point of its
outline. For a camera θ, the term is the minimum over what belongs to the vehicles themselves,

    min Σᵢ wᵢ ρ(|rᵢ|²) + Σₜ ρₜ(zₜ) + |u|²,    r = (predicted edge - edge) / σ,

where every sighting i has a position on the ground, every track t has z = (log length, width,
height, turn) under the prior of its class, and u is what all vehicles share: the mean sizes of the
fleet, as far as the detector's boxes are not too large or small altogether, and boxes that grow
with distance. The turn is an error of the direction of motion in the image. ρ is the Geman-McClure
loss: partly hidden vehicles are outliers as sightings, wrong classes as tracks.

All of it is a Gauss-Newton system with three levels, eliminated one after the other (Schur
complements). Lengths are in camera heights. Leading axes of arrays are k cameras, n sightings.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.calibration._body import HEIGHT, N_PARAMETERS
from scene4d.calibration._many_views import NEAREST, View
from scene4d.calibration._problem import TermValue
from scene4d.core.vehicle_shapes import SHAPES

KINDS: tuple[str, ...] = ("car", "truck", "bus", "vehicle")
"""Classes that serve as rulers. Boxes of two-wheelers may or may not include the rider."""
_FLEET = np.linalg.cholesky(
    np.array([[1.0, 0.6, 0.6], [0.6, 1.0, 0.6], [0.6, 0.6, 1.0]])
    * np.outer([0.09, 0.08, 0.06], [0.09, 0.08, 0.06])
)
"""Root of the covariance of log length, width and height of the mean vehicle of a place, against
those of ``core.vehicle_shapes``: cars of its four data sets differ by 0.10, 0.10 and 0.06, widths
with and without mirrors. A detector's boxes may be too large or small by about as much."""
_GROWTH_SIGMA = 0.03
"""Relative growth of boxes per e-fold of their size, shared by all: as for people
(``_uncertainty``)."""
_COMMON = 0.05
"""Correlation of the errors of different vehicles beyond what they share by name: how bodies and a
detector's boxes differ from the outlines of ``core.vehicle_shapes``. t vehicles count as
``t / (1 + (t - 1) 0.05)``, 20 at most. Chosen on MEVA's four cameras and a motorway, where focal
lengths were 1.4 to 3 standard deviations off without it."""
_SIGHTING_WIDTH2 = 16.0
_TRACK_WIDTH2 = 16.0
"""Squared widths of the Geman-McClure losses, in variances: sightings have two degrees of freedom
left, tracks four. Half of the weight is lost at 2.6 standard deviations."""
_ROUNDS, _SETTLED = 10, 1e-3
"""Gauss-Newton steps for the vehicles' own unknowns, at most, and the change of the cost at which
they are found."""
_MIDDLE = 0.5
"""The middle of a box shows a point at about half the vehicle's height."""
_STEP = 1e-5
"""Half width of central differences, in units of the parameters (radians, shares)."""
_OUTWARD = np.array([-1.0, -1.0, 1.0, 1.0])
"""Left, top, right, bottom."""
_ROOF_SIGMA = 0.08
"""Where along the vehicle, in lengths, the top edge touches: cars differ by that (the roof of a
saloon ends 0.2 behind the middle, that of an estate 0.45), and so may those of a street."""
_OWN, _SHARED = 4, 7
_GROWTHS, _ROOF, _MARGIN = (3, 4), 5, 6
"""Unknowns of a track (sizes and turn), and of all vehicles (mean sizes; growth of width and of
height; roof; margin)."""
_TOP = 1
_LARGEST = 0.5
"""Largest step of a track's unknowns: an e-fold is 1, the turn is in standard deviations."""


@dataclass(frozen=True, eq=False)
class Vehicles:
    """Sightings of moving vehicles in the solver's frame (centred, half diagonals), sorted by
    track; a :class:`.Term` of the solver.

    ``edge`` is where the left, top, right and bottom edges are, measured along ``axis`` (unit
    vectors where the lens is the solver's), with the standard deviations ``sigma``. ``back`` and
    ``front`` are the middle of the box before and after, ``turn`` one standard deviation of the
    front across the motion, ``margin`` that by which boxes are too large all round.
    ``kind`` is the class of each track.
    """

    edge: Float[np.ndarray, "n 4"]
    axis: Float[np.ndarray, "n 4 2"]
    sigma: Float[np.ndarray, "n 4"]
    middle: Float[np.ndarray, "n 2"]
    back: Float[np.ndarray, "n 2"]
    front: Float[np.ndarray, "n 2"]
    turn: Float[np.ndarray, "n 2"]
    track: Int[np.ndarray, "n"]
    margin: Float[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    kind: tuple[str, ...]

    def at(self, parameters: Float[np.ndarray, "7"]) -> TermValue:
        """The value at a camera, with all that belongs to the vehicles eliminated."""
        here = parameters[None]
        fit = self.fitted(here)
        system = self._system(here, fit, self._by_camera(parameters, fit))
        hessian, gradient = system.outer(N_PARAMETERS)
        return TermValue(float(fit.cost[0]), gradient[0], hessian[0])

    def select(self, rows: np.ndarray) -> "Vehicles":
        """Some of the sightings, in order."""
        tracks, track = np.unique(self.track[rows], return_inverse=True)
        names = ("edge", "axis", "sigma", "middle", "back", "front", "turn", "margin", "weight")
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in names},
            track=track,
            kind=tuple(self.kind[t] for t in tracks),
        )

    @property
    def dependence(self) -> float:
        """What each of so many vehicles counts, since they err together."""
        return 1 / (1 + _COMMON * (len(self.kind) - 1))

    def agreeing(self, parameters: Float[np.ndarray, "7"]) -> Bool[np.ndarray, "n"]:
        """Which sightings fit the camera: more than half of their weight is left."""
        here = parameters[None]
        system = self._system(here, self.fitted(here))
        agree: np.ndarray = _shrink(system.chi2[0], _SIGHTING_WIDTH2) ** 2 > 0.5
        return agree & (_shrink(system.odd[0], _TRACK_WIDTH2) ** 2 > 0.25)[self.track]

    @cached_property
    def starts(self) -> Int[np.ndarray, "t"]:
        """The first row of every track."""
        return np.flatnonzero(np.diff(self.track, prepend=-1))

    @cached_property
    def _size_m(self) -> Float[np.ndarray, "n 3"]:
        return np.stack([SHAPES[self.kind[t]].size_m for t in self.track])

    @cached_property
    def _outline(self) -> Float[np.ndarray, "n p 3"]:
        most = max(len(SHAPES[kind].headed) for kind in self.kind)
        padded = {kind: np.resize(SHAPES[kind].headed, (most, 3)) for kind in set(self.kind)}
        return np.stack([padded[self.kind[t]] for t in self.track])

    @cached_property
    def _own_prior(self) -> Float[np.ndarray, "t 4 4"]:
        prior = np.zeros((len(self.kind), _OWN, _OWN))
        for row, kind in zip(prior, self.kind, strict=True):
            row[:3, :3] = np.linalg.inv(SHAPES[kind].log_covariance)
            row[3, 3] = 1.0
        return prior

    @cached_property
    def _growth(self) -> Float[np.ndarray, "n 4 2"]:
        """How far the edges move outwards where boxes grow in width, and in height, by an e-fold
        per e-fold of their size.
        """
        half = np.abs(self.edge[:, [2, 3, 2, 3]] - self.edge[:, [0, 1, 0, 1]]) / 2
        size = np.log(half[:, :2]).mean(axis=1)
        moved = _OUTWARD * half * (size - np.median(size))[:, None]
        return moved[..., None] * [[1, 0], [0, 1], [1, 0], [0, 1]]

    def fitted(self, parameters: Float[np.ndarray, "k 7"], rounds: int = _ROUNDS) -> "Fit":
        """The vehicles' own unknowns at given cameras."""
        view = View.of(parameters)
        lift = _MIDDLE * self._size_m[:, 2] / np.exp(parameters[:, HEIGHT, None])
        xy, valid = view.on_plane(self.middle, lift)
        k, t = len(parameters), len(self.kind)
        fit = Fit(xy, np.zeros((k, t, _OWN)), np.zeros((k, _SHARED)), valid, np.zeros(k))
        for _ in range(rounds):
            system, before = self._system(parameters, fit), fit.cost
            fit = replace(fit, cost=system.cost)
            if (np.abs(fit.cost - before) < _SETTLED).all():
                break
            fit = system.stepped(fit)
        return fit

    def _headings(self, view: "View", own: np.ndarray, log_height: np.ndarray) -> np.ndarray:
        """Direction of motion (2, k, n) on the ground, and its derivative by the turn."""
        lift = _MIDDLE * self._size_m[:, 2] / np.exp(log_height[:, None])
        back = view.on_plane(self.back, lift)[0]

        def towards(amount: np.ndarray | float) -> np.ndarray:
            front = view.on_plane(self.front + amount * self.turn, lift)[0] - back
            return np.arctan2(front[..., 1], front[..., 0])

        turn = own[:, self.track, 3, None]
        change = towards(turn + 0.05) - towards(turn - 0.05)
        change = (change + np.pi) % (2 * np.pi) - np.pi
        return np.stack([towards(turn), change / 0.1])

    def _dimensions(self, own: np.ndarray, log_height: np.ndarray) -> np.ndarray:
        """Length, width and height (k, n, 3) in camera heights."""
        return self._size_m * np.exp(own[:, self.track, :3] - log_height[:, None, None])

    def _points(
        self, xy: np.ndarray, heading: np.ndarray, size: np.ndarray, fraction: np.ndarray
    ) -> np.ndarray:
        """Points (k, n, p, 3) of the vehicles in the world, from fractions of the cuboids."""
        along, across, up = np.moveaxis(fraction * size[:, :, None], -1, 0)
        c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
        x, y = xy[..., 0, None], xy[..., 1, None]
        return np.stack([x + along * c - across * s, y + along * s + across * c, up], axis=-1)

    def _system(
        self, parameters: np.ndarray, fit: "Fit", by_camera: np.ndarray | None = None
    ) -> "_System":
        """The Gauss-Newton system at a state; with the derivatives (k, n, 4, 7) by the camera."""
        view, log_height = View.of(parameters), parameters[:, HEIGHT]
        heading, by_turn = self._headings(view, fit.own, log_height)
        size = self._dimensions(fit.own, log_height)
        outline = np.broadcast_to(self._outline, (len(parameters), *self._outline.shape))
        seen, depth = view.project(self._points(fit.xy, heading, size, outline))
        valid = fit.valid & (depth.min(axis=-1) > NEAREST)
        reach = np.einsum("nec,knpc->knep", self.axis * _OUTWARD[:, None], seen)
        active = reach.argmax(axis=-1)
        fraction = np.take_along_axis(outline, active[..., None], axis=2)
        predicted = _OUTWARD * np.take_along_axis(reach, active[..., None], axis=-1)[..., 0]

        by_point = view.slopes(self._points(fit.xy, heading, size, fraction), self.axis)
        along, across, up = np.moveaxis(fraction * size[:, :, None], -1, 0)
        c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
        forward = by_point[..., 0] * c + by_point[..., 1] * s
        aside = by_point[..., 1] * c - by_point[..., 0] * s
        turned = (along * aside - across * forward) * by_turn[..., None]
        by_own = np.stack([along * forward, across * aside, up * by_point[..., 2], turned], -1)
        sigma = self.sigma[..., None]
        by_shared = np.zeros((*predicted.shape, _SHARED))
        by_shared[..., _GROWTHS] = _GROWTH_SIGMA * self._growth
        by_shared[..., _MARGIN] = self.margin[:, None] * _OUTWARD
        ends = np.sign(fraction[:, :, _TOP, 0]) * size[..., 0]
        by_shared[..., _TOP, _ROOF] = _ROOF_SIGMA * ends * forward[..., _TOP]
        outer = by_shared if by_camera is None else np.concatenate([by_camera, by_shared], -1)
        also = (by_shared @ fit.shared[:, None, :, None])[..., 0]
        return _System(
            self,
            fit,
            residual=(predicted + also - self.edge) / self.sigma,
            by_xy=by_point[..., :2] / sigma,
            by_own=by_own / sigma,
            by_outer=outer / sigma,
            valid=valid,
            fraction=fraction,
        )

    def _by_camera(self, parameters: np.ndarray, fit: "Fit") -> np.ndarray:
        """Derivatives (1, n, 4, 7) of the edges by the camera, by central differences."""
        fraction = self._system(parameters[None], fit).fraction
        steps = np.concatenate([_STEP * np.eye(N_PARAMETERS), -_STEP * np.eye(N_PARAMETERS)])
        near = parameters + steps
        view = View.of(near)
        heading = self._headings(view, fit.own, near[:, HEIGHT])[0]
        size = self._dimensions(fit.own, near[:, HEIGHT])
        seen, _ = view.project(self._points(fit.xy, heading, size, fraction))
        edge = np.einsum("nec,knec->kne", self.axis, seen)
        slope = (edge[:N_PARAMETERS] - edge[N_PARAMETERS:]) / (2 * _STEP)
        return np.moveaxis(slope, 0, -1)[None]


@dataclass(frozen=True, eq=False)
class Fit:
    """The vehicles at k cameras: positions (camera heights), logarithms of sizes over those of
    the class with the turn (standard deviations), and what all share (standard deviations).
    """

    xy: Float[np.ndarray, "k n 2"]
    own: Float[np.ndarray, "k t 4"]
    shared: Float[np.ndarray, "k 7"]
    valid: Bool[np.ndarray, "k n"]
    cost: Float[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class _System:
    """Residuals in sigmas, and derivatives by positions, tracks, and the outer unknowns (those of
    the camera, if any, then the shared ones).
    """

    vehicles: Vehicles
    fit: Fit
    residual: np.ndarray
    by_xy: np.ndarray
    by_own: np.ndarray
    by_outer: np.ndarray
    valid: np.ndarray
    fraction: np.ndarray

    @cached_property
    def chi2(self) -> Float[np.ndarray, "k n"]:
        """Misfit of every sighting; infinite where it is not in front of the camera."""
        return np.where(self.valid, (self.residual**2).sum(axis=-1), np.inf)

    @cached_property
    def gap(self) -> Float[np.ndarray, "k t 4"]:
        """The tracks' own unknowns against what their classes have, in this fleet."""
        fleet = np.zeros((len(self.fit.own), 1, _OWN))
        fleet[:, 0, :3] = self.fit.shared[:, :3] @ _FLEET.T
        return self.fit.own - fleet

    @cached_property
    def odd(self) -> Float[np.ndarray, "k t"]:
        """How unusual a vehicle is for its class: squared, in variances."""
        return np.einsum("kti,tij,ktj->kt", self.gap, self.vehicles._own_prior, self.gap)

    @property
    def cost(self) -> Float[np.ndarray, "k"]:
        """-2 log p up to a constant."""
        sightings = _SIGHTING_WIDTH2 * (1 - _shrink(self.chi2, _SIGHTING_WIDTH2))
        tracks = _TRACK_WIDTH2 * (1 - _shrink(self.odd, _TRACK_WIDTH2))
        shared = (self.fit.shared**2).sum(axis=-1)
        vehicles = sightings @ self.vehicles.weight + tracks.sum(axis=-1)
        return self.vehicles.dependence * vehicles + shared

    @cached_property
    def weight(self) -> Float[np.ndarray, "k n"]:
        """What every sighting counts."""
        weight = self.vehicles.weight * _shrink(self.chi2, _SIGHTING_WIDTH2) ** 2
        return self.vehicles.dependence * weight

    @cached_property
    def _without_positions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives by tracks and outer unknowns, and residuals, with positions eliminated."""
        by_xy = self.by_xy
        normal = np.swapaxes(by_xy, -1, -2) @ by_xy + 1e-9 * np.eye(2)
        every = np.concatenate([self.by_own, self.by_outer, self.residual[..., None]], axis=-1)
        rest = every - by_xy @ np.linalg.solve(normal, np.swapaxes(by_xy, -1, -2) @ every)
        return rest[..., :_OWN], rest[..., _OWN:-1], rest[..., -1]

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, ...]:
        """Hessian blocks and gradients of tracks and outer unknowns: (tt, to, oo, t, o)."""
        vehicles, gap = self.vehicles, self.gap
        own, outer, rest = self._without_positions
        weight = self.weight[..., None]
        start, m = vehicles.starts, outer.shape[-1]

        def per_track(values: np.ndarray) -> np.ndarray:
            return np.add.reduceat(values, start, axis=1)

        own_t, outer_t = np.swapaxes(own, -1, -2), np.swapaxes(outer, -1, -2)
        loss = vehicles.dependence * _shrink(self.odd, _TRACK_WIDTH2) ** 2
        prior = loss[..., None, None] * vehicles._own_prior
        fleet = np.zeros((_OWN, m))
        fleet[:3, m - _SHARED : m - _SHARED + 3] = _FLEET
        tt = per_track(weight[..., None] * (own_t @ own)) + prior
        to = per_track(weight[..., None] * (own_t @ outer)) - prior @ fleet
        oo = (weight[..., None] * (outer_t @ outer)).sum(axis=1)
        oo += (fleet.T @ prior @ fleet).sum(axis=1)
        pull = (prior @ gap[..., None])[..., 0]
        t = per_track(weight * (own_t @ rest[..., None])[..., 0]) + pull
        o = (weight * (outer_t @ rest[..., None])[..., 0]).sum(axis=1) - pull.sum(axis=1) @ fleet
        shared = slice(m - _SHARED, m)
        oo[:, range(m)[shared], range(m)[shared]] += 1.0
        o[:, shared] += self.fit.shared
        return tt, to, oo, t, o

    @cached_property
    def _without_tracks(self) -> tuple[np.ndarray, np.ndarray]:
        tt, to, oo, t, o = self._blocks
        solved = np.linalg.solve(tt, np.concatenate([to, t[..., None]], axis=-1))
        hessian = oo - (np.swapaxes(to, -1, -2) @ solved[..., :-1]).sum(axis=1)
        gradient = o - (np.swapaxes(to, -1, -2) @ solved[..., -1:]).sum(axis=1)[..., 0]
        return hessian, gradient

    def outer(self, camera: int) -> tuple[np.ndarray, np.ndarray]:
        """Hessian (k, c, c) and gradient over the camera with the shared unknowns eliminated."""
        hessian, gradient = self._without_tracks
        cross = hessian[:, :camera, camera:]
        every = np.concatenate([np.swapaxes(cross, -1, -2), gradient[:, camera:, None]], axis=-1)
        solved = np.linalg.solve(hessian[:, camera:, camera:], every)
        kept = hessian[:, :camera, :camera] - cross @ solved[..., :-1]
        return kept, gradient[:, :camera] - (cross @ solved[..., -1:])[..., 0]

    def stepped(self, fit: Fit) -> Fit:
        """The vehicles after one Gauss-Newton step; of a system without a camera."""
        hessian, gradient = self._without_tracks
        shared = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
        tt, to, _, t, _ = self._blocks
        pull = t + (to @ shared[:, None, :, None])[..., 0]
        own = np.clip(-np.linalg.solve(tt, pull[..., None])[..., 0], -_LARGEST, _LARGEST)
        at = self.vehicles.track
        moved = self.residual + (self.by_own @ own[:, at, :, None])[..., 0]
        moved = moved + (self.by_outer @ shared[:, None, :, None])[..., 0]
        by_xy = self.by_xy
        normal = np.swapaxes(by_xy, -1, -2) @ by_xy + 1e-9 * np.eye(2)
        xy = -np.linalg.solve(normal, np.swapaxes(by_xy, -1, -2) @ moved[..., None])[..., 0]
        reach = np.hypot(fit.xy[..., 0], fit.xy[..., 1]) + 0.1
        xy *= np.minimum(1.0, 0.4 * reach / np.maximum(np.hypot(*np.moveaxis(xy, -1, 0)), 1e-12))[
            ..., None
        ]
        return replace(
            fit,
            xy=np.where(self.valid[..., None], fit.xy + xy, fit.xy),
            own=fit.own + own,
            shared=fit.shared + shared,
        )


def _shrink(squared: np.ndarray, width2: float) -> np.ndarray:
    """Geman-McClure: the square root of the weight of a squared residual."""
    return width2 / (width2 + squared)
