"""Landmarks as a term of the joint estimate.

The frame of the ground points (rotation and shift) is eliminated here: found by Gauss-Newton for
each camera, and its share of the information taken out (Schur complement). Where one landmark can
be told from the others, each may be mistyped with a small probability: a mixture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import CORNER, HEIGHT, N_PARAMETERS, ROLL, TILT, foot_rays
from scene4d.calibration._case import ImageFrame
from scene4d.calibration._landmark_residuals import (
    FRAME,
    Pixels,
    Residuals,
    Weighed,
    of_distances,
    of_points,
    of_uprights,
    weighed,
)
from scene4d.calibration._lines import directions
from scene4d.calibration._problem import TermValue
from scene4d.core.landmarks import Landmarks

_DISTANCE_RANGE = 3.0
"""Range of the logarithm of a mistyped distance: a factor of 20, as from feet to inches."""
_SPARE = 3
"""Landmarks can tell which of them is wrong if they have so many numbers more than the camera and
the frame: two that the wrong one takes with it, and one that then confirms the others."""
_POSE = 4
"""Numbers of a camera that landmarks must tell: focal length, tilt, roll and height."""
_FRAME_STEPS = 8
_RIDGE = 1e-9
"""Relative information about a frame that no landmark tells."""


@dataclass(frozen=True, eq=False)
class LandmarkTerm:
    """Landmarks of one camera as a :class:`.refine.Term`, in the solver's frame.

    ``blur`` (half diagonals) is added to the error of every pixel for a search from afar.
    ``robust`` says that one of them may be mistyped.
    """

    points: Pixels
    xyz_m: Float[np.ndarray, "3 n"]
    point_sigma_m: Float[np.ndarray, "n"]
    feet: Pixels
    tops: Pixels
    height_m: Float[np.ndarray, "k"]
    height_sigma_m: Float[np.ndarray, "k"]
    ends: tuple[Pixels, Pixels]
    distance_m: Float[np.ndarray, "d"]
    distance_sigma_m: Float[np.ndarray, "d"]
    log_area: float
    robust: bool

    @classmethod
    def of(cls, known: Landmarks, frame: ImageFrame) -> "LandmarkTerm":
        """The term of landmarks in pixels of the footage."""
        points, uprights, distances = known.points, known.uprights, known.distances

        def pixels(items: Sequence[Any], uv: list[tuple[float, float]]) -> Pixels:
            return Pixels.of(frame, np.array(uv, float).reshape(-1, 2), _column(items, "sigma_px"))

        xy_m = np.array([point.xy_m for point in points], float).reshape(-1, 2)
        centred = xy_m - xy_m.mean(axis=0) if len(points) else xy_m
        size = np.array(frame.image_size) / frame.half_diagonal_px
        return cls(
            points=pixels(points, [point.uv for point in points]),
            xyz_m=np.vstack([centred.T, _column(points, "height_m")]),
            point_sigma_m=_column(points, "sigma_m"),
            feet=pixels(uprights, [upright.foot_uv for upright in uprights]),
            tops=pixels(uprights, [upright.head_uv for upright in uprights]),
            height_m=_column(uprights, "height_m"),
            height_sigma_m=_column(uprights, "sigma_m"),
            ends=(
                pixels(distances, [distance.uv[0] for distance in distances]),
                pixels(distances, [distance.uv[1] for distance in distances]),
            ),
            distance_m=_column(distances, "distance_m"),
            distance_sigma_m=_column(distances, "sigma_m"),
            log_area=float(np.log(size.prod())),
            robust=numbers_told(known) >= _POSE + _SPARE,
        )

    def at(self, parameters: Float[np.ndarray, "7"]) -> TermValue:
        """Its value at a camera, with the frame of the ground points eliminated."""
        all_of = self._together(parameters, self.frame_at(parameters))
        camera = slice(0, N_PARAMETERS)
        hessian, gradient = all_of.hessian[camera, camera], all_of.gradient[camera]
        if len(self.point_sigma_m):
            coupling = all_of.hessian[camera, FRAME]
            scaled = np.linalg.solve(_ridged(all_of.hessian[FRAME, FRAME]), coupling.T).T
            hessian = hessian - scaled @ coupling.T
            gradient = gradient - scaled @ all_of.gradient[FRAME]
        return TermValue(all_of.cost, gradient, (hessian + hessian.T) / 2)

    def blurred(self, blur: float) -> "LandmarkTerm":
        """With pixels known worse by ``blur`` (half diagonals), and distances by that share."""
        more = blur**2 * np.eye(2)
        wide = self._seen(lambda pixels: replace(pixels, covariance=pixels.covariance + more))
        sigma_m = np.hypot(self.distance_sigma_m, blur * self.distance_m)
        return replace(wide, distance_sigma_m=sigma_m)

    def with_fisheye(self) -> "LandmarkTerm":
        """The same behind a fisheye lens."""
        return self._seen(lambda pixels: replace(pixels, fisheye=True))

    def stretched(self, factor: float) -> "LandmarkTerm":
        """With all standard deviations larger by a factor."""
        return replace(
            self._seen(lambda pixels: replace(pixels, covariance=factor**2 * pixels.covariance)),
            point_sigma_m=factor * self.point_sigma_m,
            height_sigma_m=factor * self.height_sigma_m,
            distance_sigma_m=factor * self.distance_sigma_m,
        )

    def _seen(self, change: Callable[[Pixels], Pixels]) -> "LandmarkTerm":
        """With all pixels changed alike."""
        points, feet, tops, one, other = map(
            change, (self.points, self.feet, self.tops, *self.ends)
        )
        return replace(self, points=points, feet=feet, tops=tops, ends=(one, other))

    def mirrored(self) -> "LandmarkTerm":
        """The same with y to the right of x."""
        return replace(self, xyz_m=self.xyz_m * np.array([[1.0], [-1.0], [1.0]]))

    def of_kinds(
        self, parameters: Float[np.ndarray, "7"], frame: Float[np.ndarray, "3"]
    ) -> list[Residuals]:
        """Residuals of ground points, uprights and distances, in this order."""
        stray, none = -self.log_area, Residuals.none
        uprights = self.feet, self.tops, self.height_m, self.height_sigma_m, stray
        distances = (
            self.ends,
            self.distance_m,
            self.distance_sigma_m,
            -float(np.log(_DISTANCE_RANGE)),
        )
        return [
            self._of_points(parameters, frame) if len(self.point_sigma_m) else none(2),
            of_uprights(parameters, *uprights) if len(self.height_m) else none(2),
            of_distances(parameters, *distances) if len(self.distance_m) else none(1),
        ]

    def _of_points(self, parameters: np.ndarray, frame: np.ndarray) -> Residuals:
        return of_points(
            parameters, frame, self.points, self.xyz_m, self.point_sigma_m, -self.log_area
        )

    def _together(self, parameters: np.ndarray, frame: np.ndarray) -> Weighed:
        kinds = [r for r in self.of_kinds(parameters, frame) if len(r.value)]
        parts = [weighed(residuals, robust=self.robust) for residuals in kinds]
        return Weighed(
            sum(part.cost for part in parts),
            np.sum([part.gradient for part in parts], axis=0),
            np.sum([part.hessian for part in parts], axis=0),
            np.concatenate([part.right for part in parts]),
        )

    def rough_cost(self, parameters: Float[np.ndarray, "7"]) -> float:
        """The cost at a camera with a frame in closed form, which is good for a search."""
        frame = self._rough_frame(parameters) if len(self.point_sigma_m) else np.zeros(3)
        return self._together(parameters, frame).cost

    def right(self, parameters: Float[np.ndarray, "7"]) -> Float[np.ndarray, "n"]:
        """Probability of each landmark, points, uprights, distances, not to be mistyped."""
        return self._together(parameters, self.frame_at(parameters)).right

    def frame_at(self, parameters: Float[np.ndarray, "7"]) -> Float[np.ndarray, "3"]:
        """The most probable frame of the ground points for a camera: rotation (radians) and shift
        (m); zero without any.
        """
        if not len(self.point_sigma_m):
            return np.zeros(3)
        frame = self._rough_frame(parameters)
        here = weighed(self._of_points(parameters, frame), robust=self.robust)
        for _ in range(_FRAME_STEPS):
            step = -np.linalg.solve(_ridged(here.hessian[FRAME, FRAME]), here.gradient[FRAME])
            if -float(step @ here.gradient[FRAME]) < 1e-8:
                break
            for shorter in (1.0, 0.3, 0.05):
                trial = frame + shorter * step
                there = weighed(self._of_points(parameters, trial), robust=self.robust)
                if there.cost < here.cost:
                    break
            else:
                break
            frame, here = trial, there
        return frame

    def _rough_frame(self, parameters: np.ndarray) -> np.ndarray:
        """By rigid alignment on the ground of all points, or of all but one where that fits."""
        seen, weight = self.on_ground(parameters)
        here = np.exp(parameters[HEIGHT]) * seen
        stand = self.xyz_m[0] + 1j * self.xyz_m[1]
        if (weight > 0).sum() < 2:
            return np.zeros(3)
        # Rows: with all, then without each one.
        sets = (
            np.vstack([weight, weight * (1 - np.eye(len(weight)))]) if self.robust else weight[None]
        )
        share = sets / np.maximum(sets.sum(axis=1, keepdims=True), 1e-300)
        middle, origin = share @ here, share @ stand
        turned = (share * np.conj(stand - origin[:, None]) * (here - middle[:, None])).sum(axis=1)
        angle = np.angle(turned)
        expected = np.exp(1j * angle)[:, None] * (stand - origin[:, None]) + middle[:, None]
        off2 = np.where(weight > 0, np.abs(expected - here) ** 2 * weight, 9.0)
        best = int(np.minimum(off2, 9.0).sum(axis=1).argmin()) if self.robust else 0
        shift = np.exp(-1j * angle[best]) * middle[best] - origin[best]
        return np.array([angle[best], shift.real, shift.imag])

    def on_ground(
        self, parameters: Float[np.ndarray, "7"]
    ) -> tuple[np.ndarray, Float[np.ndarray, "n"]]:
        """Ground points as complex numbers in heights of the camera, and weights (1/m²): 0 where
        there is none.
        """
        (up, x_axis, y_axis), _ = directions(parameters[TILT], parameters[ROLL], 0.0)
        height, focal = np.exp(parameters[HEIGHT]), np.exp(parameters[0])
        rays = foot_rays(parameters, self.points.as_feet(), ())
        ray = np.vstack([rays.points, np.ones(rays.points.shape[1])])
        down = -(up @ ray)
        above = 1 - self.xyz_m[2] / height
        valid = rays.valid & (down * np.sign(above) > 1e-4)
        at = above / np.where(valid, down, 1.0) * ray
        far2 = (at * at).sum(axis=0) * (ray * ray).sum(axis=0)
        pixel2 = np.trace(self.points.covariance, axis1=1, axis2=2) / 2
        along2 = height**2 * far2 * pixel2 / (focal * np.where(valid, down, 1.0)) ** 2
        weight = np.where(valid, 1 / (self.point_sigma_m**2 + along2), 0.0)
        return x_axis @ at + 1j * (y_axis @ at), weight

    def without(self, index: int) -> "LandmarkTerm":
        """All but one, counted as points, uprights, distances."""
        sizes = [len(self.point_sigma_m), len(self.height_m), len(self.distance_m)]
        every = np.split(np.arange(sum(sizes)) != index, np.cumsum(sizes)[:-1])
        points, uprights, distances = every
        return replace(
            self,
            points=self.points.select(points),
            xyz_m=self.xyz_m[:, points],
            point_sigma_m=self.point_sigma_m[points],
            feet=self.feet.select(uprights),
            tops=self.tops.select(uprights),
            height_m=self.height_m[uprights],
            height_sigma_m=self.height_sigma_m[uprights],
            ends=(self.ends[0].select(distances), self.ends[1].select(distances)),
            distance_m=self.distance_m[distances],
            distance_sigma_m=self.distance_sigma_m[distances],
        )

    def log_heights(
        self, orientations: Float[np.ndarray, "m 3"], corner: float
    ) -> Float[np.ndarray, "m k"]:
        """What pairs of points, distances and uprights say of the camera's log height at each
        (log f, tilt, roll); NaN where they say nothing.
        """
        i, j = np.triu_indices(len(self.point_sigma_m), 1)
        points = _on_unit_ground(orientations, self.points, corner)
        a, b = (_on_unit_ground(orientations, end, corner) for end in self.ends)
        feet = _on_unit_ground(orientations, self.feet, corner)
        tops = _on_unit_ground(orientations, self.tops, corner)
        stand = self.xyz_m[0] + 1j * self.xyz_m[1]
        # The top of an upright is seen at the place of the ground that lies beyond its foot by the
        # factor h / (h - H).
        beyond = 1 - np.abs(feet) / np.abs(tops)
        with np.errstate(divide="ignore", invalid="ignore"):
            told = [
                np.log(np.abs(stand[i] - stand[j]) / np.abs(points[:, i] - points[:, j])),
                np.log(self.distance_m / np.abs(a - b)),
                np.log(self.height_m / np.where(beyond > 0, beyond, np.nan)),
            ]
        found: np.ndarray = np.concatenate(told, axis=1)
        return np.where(np.isfinite(found), found, np.nan)


def _on_unit_ground(
    orientations: Float[np.ndarray, "m 3"], seen: Pixels, corner: float
) -> np.ndarray:
    """Ground points as complex numbers (m, n) in heights of the camera; NaN above the horizon."""
    parameters = np.zeros(N_PARAMETERS)
    parameters[CORNER] = corner
    straight = foot_rays(parameters, seen.as_feet(), ()).points
    focal, tilt, roll = orientations.T
    ct, st, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    x, y = straight[0] / np.exp(focal)[:, None], straight[1] / np.exp(focal)[:, None]
    aside = cr[:, None] * x + sr[:, None] * y
    below = cr[:, None] * y - sr[:, None] * x
    down = ct[:, None] * below + st[:, None]
    ahead = ct[:, None] - st[:, None] * below
    down = np.where(down > 1e-4, down, np.nan)
    found: np.ndarray = aside / down + 1j * (ahead / down)
    return found


def numbers_told(known: Landmarks) -> int:
    """How many numbers landmarks tell of a camera, the frame of the ground points taken out."""
    points = 2 * len(known.points) - 3 if known.points else 0
    return points + 2 * len(known.uprights) + len(known.distances)


def _column(items: Sequence[Any], name: str) -> np.ndarray:
    return np.array([getattr(item, name) for item in items], float)


def _ridged(matrix: np.ndarray) -> np.ndarray:
    return matrix + (_RIDGE * np.trace(matrix) + 1e-300) * np.eye(len(matrix))
