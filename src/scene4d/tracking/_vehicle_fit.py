"""Fits vehicles to bounding boxes: all vehicles and all starting headings at once.

A vehicle on the ground has six unknowns: the logarithms of length, width and height, the heading,
and the position (x, y) of its middle. Its image has a bounding rectangle with four edges; each is
the projection of one outline point, the active point. Levenberg-Marquardt minimises

    sum ((edge - predicted edge) / sigma)² + Gaussian priors of log dimensions and heading.

The heading prior is a mixture of Gaussians side by side ("bells"). Each bell gets its own fit, so
that no minimum is missed. The fits are weighted by Laplace's approximation
``exp(-cost / 2) / √det A`` with the information matrix A. The last two axes (n m) of all arrays
are vehicles and bells.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.camera import Camera
from scene4d.core.vehicle_shapes import VehicleShape

_ITERATIONS = 7
"""Steps of Levenberg-Marquardt. Chosen by hand."""
_MIN_DEPTH_M = 0.1
"""Least depth of a point for projection."""
_HEADING, _X, _Y = 3, 4, 5
_N = 6
_LARGEST_STEP = np.array([0.3, 0.3, 0.3, 0.4])
"""Log dimensions and radians; larger steps would change the active points. Chosen by hand."""
_OUTWARD = np.array([-1.0, -1.0, 1.0, 1.0])
"""Left, top, right, bottom."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes in pixels of the footage, the noise of their edges, and which edges are visible."""

    xyxy: Float[np.ndarray, "n 4"]
    sigma_px: Float[np.ndarray, "n 4"]
    seen: Bool[np.ndarray, "n 4"]


@dataclass(frozen=True, eq=False)
class Bells:
    """Heading prior: weighted Gaussians of one width ``sigma_rad`` about ``centre_rad``."""

    centre_rad: Float[np.ndarray, "n m"]
    sigma_rad: Float[np.ndarray, "n"]
    log_weight: Float[np.ndarray, "n m"]


@dataclass(frozen=True, eq=False)
class Fits:
    """One fit per vehicle and bell: (heading, x, y), log dimensions, their covariances, log weight.

    ``cost`` is the misfit (two degrees of freedom where all edges are visible), ``range_m`` the
    distance from the camera; ``log_weight`` is -inf where the fitted vehicle is not in front of
    the camera.
    """

    pose: Float[np.ndarray, "3 n m"]
    covariance: Float[np.ndarray, "3 3 n m"]
    log_size: Float[np.ndarray, "3 n m"]
    size_covariance: Float[np.ndarray, "3 3 n m"]
    log_weight: Float[np.ndarray, "n m"]
    cost: Float[np.ndarray, "n m"]
    range_m: Float[np.ndarray, "n m"]


def fit(camera: Camera, shape: VehicleShape, boxes: Boxes, bells: Bells) -> Fits:
    """Fit every vehicle from every bell."""
    return _Fit(camera, shape, boxes, bells).run()


class Outline:
    """Bounding rectangles of one vehicle shape, projected through the camera and its lens."""

    def __init__(self, camera: Camera, shape: VehicleShape) -> None:
        self._camera, self._shape, self._P = camera, shape, camera.P
        self._curved = camera.bends
        self._reach2 = self._image_radius2() if self._curved else np.inf

    def _image_radius2(self) -> float:
        """Largest squared radius (in focal lengths, undistorted) in the image."""
        width, height = self._camera.image_size
        u, v = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
        uv, valid = self._camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
        reach2 = float(self._radius2(*uv[valid].T).max(initial=0.01))
        # Tangential distortion folds earlier on one side: the reach must be valid on all sides.
        angle = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ self._camera.K[:2, :2].T
        while not self._camera.distort(self._camera.K[:2, 2] + np.sqrt(reach2) * circle)[1].all():
            reach2 *= 0.98
        return reach2

    def _radius2(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        K = self._camera.K
        x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
        return x * x + y * y

    def _distort(self, uv: np.ndarray) -> np.ndarray:
        """Pixels of the footage (2, ...). Outside the image the distortion polynomial may fold
        back, so the magnification at the limit is kept there.
        """
        if not self._curved:
            return uv
        radius2 = self._radius2(uv[0], uv[1])
        if radius2.max(initial=0.0) <= self._reach2:
            return self._bent(uv)
        shrink = np.sqrt(self._reach2 / np.maximum(radius2, self._reach2))
        centre = self._camera.K[:2, 2].reshape((2,) + (1,) * (uv.ndim - 1))
        return centre + (self._bent(centre + (uv - centre) * shrink) - centre) / shrink

    def _bent(self, uv: np.ndarray) -> np.ndarray:
        return self._camera.distort(uv.reshape(2, -1).T)[0].T.reshape(uv.shape)

    def lens_slope(self, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 2 n"]:
        """Derivative of distorted pixels with respect to undistorted ones, at undistorted ones."""
        slope = np.zeros((2, 2, len(uv)))
        for axis in range(2):
            step = np.zeros((2, 1))
            step[axis] = 0.5
            slope[:, axis] = self._distort(uv.T + step) - self._distort(uv.T - step)
        return slope

    def project(
        self, state: Float[np.ndarray, "6 n m"]
    ) -> tuple[
        Float[np.ndarray, "4 n m"], Float[np.ndarray, "4 2 n m"], Float[np.ndarray, "4 3 n m"]
    ]:
        """Edges (left, top, right, bottom), and the active points that define them: undistorted
        pixels (u, v) and fractions of the cuboid.
        """
        axes = self.axes(state)
        middle = self._middle(state)
        points = np.tensordot(self._shape.points, axes, (1, 0))
        points += middle
        depth = np.maximum(points[:, 2], _MIN_DEPTH_M)
        flat = np.stack([points[:, 0] / depth, points[:, 1] / depth])
        bent = self._distort(flat)
        first, last = bent.argmin(axis=1), bent.argmax(axis=1)
        active = np.concatenate([first, last])  # left, top, right, bottom
        pick = active[None]
        edges = np.stack([np.take_along_axis(bent[i % 2], pick[:, i], axis=0)[0] for i in range(4)])
        uv = np.stack(
            [
                np.concatenate([np.take_along_axis(c, pick[:, i], axis=0) for c in flat])
                for i in range(4)
            ]
        )
        fractions = np.moveaxis(self._shape.points[active], -1, 1)
        return edges, uv, fractions

    def axes(self, state: np.ndarray) -> np.ndarray:
        """Homogeneous pixels of the cuboid's length, width and height, (3, 3, n, m)."""
        size = np.exp(state[:3]) * self._shape.size_m[:, None, None]
        c, s = np.cos(state[_HEADING]), np.sin(state[_HEADING])
        P = self._P[:, :, None, None]
        return np.stack(
            [
                size[0] * (P[:, 0] * c + P[:, 1] * s),
                size[1] * (P[:, 1] * c - P[:, 0] * s),
                size[2] * P[:, 2],
            ]
        )

    def _middle(self, state: np.ndarray) -> np.ndarray:
        P = self._P[:, :, None, None]
        return P[:, 0] * state[_X] + P[:, 1] * state[_Y] + P[:, 3]

    def depth(self, state: np.ndarray) -> np.ndarray:
        """Least depth of the outline (n, m), in metres."""
        axes = self.axes(state)[:, 2]
        return (np.tensordot(self._shape.points, axes, (1, 0)) + self._middle(state)[2]).min(axis=0)

    def slopes(
        self, state: np.ndarray, uv: np.ndarray, fractions: np.ndarray, lens: np.ndarray
    ) -> np.ndarray:
        """Derivative of the edges with respect to the state, (4, 6, n, m); ``lens`` is from
        :meth:`lens_slope`.
        """
        P, axes, middle = self._P, self.axes(state), self._middle(state)
        along, across, up = np.moveaxis(fractions, 1, 0)
        depth = np.maximum(
            along * axes[0, 2] + across * axes[1, 2] + up * axes[2, 2] + middle[2], _MIN_DEPTH_M
        )
        row = lens[[0, 1, 0, 1]][..., None] / depth[:, None]  # (4, 2, n, m)
        # Derivative with respect to the homogeneous pixel (q0, q1, q2), uv = (q0, q1) / q2.
        by = (row[:, 0], row[:, 1], -(row[:, 0] * uv[:, 0] + row[:, 1] * uv[:, 1]))
        ground = [by[0] * P[0, j] + by[1] * P[1, j] + by[2] * P[2, j] for j in range(2)]
        by_axis = [by[0] * a[0] + by[1] * a[1] + by[2] * a[2] for a in axes]
        c, s = np.cos(state[_HEADING]), np.sin(state[_HEADING])
        size = np.exp(state[:2]) * self._shape.size_m[:2, None, None]
        turned = along * size[0] * (ground[1] * c - ground[0] * s)
        turned -= across * size[1] * (ground[0] * c + ground[1] * s)
        return np.stack(
            [along * by_axis[0], across * by_axis[1], up * by_axis[2], turned, *ground], axis=1
        )


class _Fit:
    def __init__(self, camera: Camera, shape: VehicleShape, boxes: Boxes, bells: Bells) -> None:
        self._camera, self._shape, self._boxes, self._bells = camera, shape, boxes, bells
        self._outline = Outline(camera, shape)
        middle = (boxes.xyxy[:, :2] + boxes.xyxy[:, 2:]) / 2
        self._middle_uv, self._valid = camera.undistort(middle)
        self._middle_uv[~self._valid] = camera.K[:2, 2]
        self._lens = self._outline.lens_slope(self._middle_uv)
        self._edges = boxes.xyxy.T[:, :, None]
        self._sigma = boxes.sigma_px.T[:, :, None]
        self._seen = boxes.seen.T[:, :, None]
        self._prior = np.linalg.inv(shape.log_covariance)

    def run(self) -> Fits:
        state = self._start()
        damping = np.full(state.shape[1:], 1e-3)
        cost, information, gradient = self._linearise(state)
        for _ in range(_ITERATIONS):
            step = self._step(state, information, gradient, damping)
            trial = state + step
            new_cost, new_information, new_gradient = self._linearise(trial)
            better = new_cost <= cost
            state = np.where(better, trial, state)
            cost = np.where(better, new_cost, cost)
            information = np.where(better, new_information, information)
            gradient = np.where(better, new_gradient, gradient)
            damping = np.where(better, damping * 0.2, np.maximum(damping * 10, 0.1))
        return self._fits(state, cost)

    def _range(self, state: np.ndarray) -> np.ndarray:
        centre = self._camera.centre_m
        return np.sqrt((state[_X] - centre[0]) ** 2 + (state[_Y] - centre[1]) ** 2 + centre[2] ** 2)

    def _start(self) -> np.ndarray:
        """Typical vehicles on the ray through the box's middle, at half their height. Where the
        ray meets that plane too far away or never, the size of the box gives the distance.
        """
        camera, size = self._camera, self._shape.size_m
        K, centre = camera.K, camera.centre_m
        y = (self._middle_uv[:, 1] - K[1, 2]) / K[1, 1]
        x = (self._middle_uv[:, 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
        ray = np.column_stack([x, y, np.ones_like(x)]) @ camera.R
        drop = size[2] / 2 - centre[2]
        with np.errstate(divide="ignore"):
            on_ground = np.where(ray[:, 2] * drop > 0, drop / ray[:, 2], np.inf)
        wide, high = (self._boxes.xyxy[:, 2:] - self._boxes.xyxy[:, :2]).T
        by_size = camera.focal_px * np.hypot(size[:2].mean(), size[2]) / np.hypot(wide, high)
        play = np.where(self._boxes.seen.all(axis=1), 1.6, 4.0)
        depth = np.clip(on_ground, by_size / play, by_size * play)
        state = np.zeros((_N, *self._bells.centre_rad.shape))
        state[_HEADING] = self._bells.centre_rad
        state[_X:] = (centre[:2] + ray[:, :2] * depth[:, None]).T[:, :, None]
        return state

    def _linearise(
        self, state: np.ndarray, *, seen_only: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost (n, m), information (6, 6, n, m), and half the negative gradient (6, n, m).

        An edge at the image border shows only that the vehicle extends at least to it.
        """
        edges, uv, fractions = self._outline.project(state)
        residual = (self._edges - edges) / self._sigma
        ends_inside = residual * _OUTWARD[:, None, None] > 0
        used = self._seen | ends_inside
        residual = np.where(used, residual, 0.0)
        slopes = self._outline.slopes(state, uv, fractions, self._lens) / self._sigma[:, None]
        slopes *= (self._seen if seen_only else used)[:, None]
        off_heading = state[_HEADING] - self._bells.centre_rad
        bell = 1 / self._bells.sigma_rad[:, None] ** 2
        pull = np.einsum("ij,jnm->inm", self._prior, state[:3])
        information = np.zeros((_N, _N, *state.shape[1:]))  # only the lower half is used
        gradient = np.empty_like(state)
        for i in range(_N):
            gradient[i] = (slopes[:, i] * residual).sum(axis=0)
            for j in range(i + 1):
                information[i, j] = (slopes[:, i] * slopes[:, j]).sum(axis=0)
        gradient[:3] -= pull
        gradient[_HEADING] -= bell * off_heading
        information[:3, :3] += self._prior[:, :, None, None]
        information[_HEADING, _HEADING] += bell
        # Far weaker than any box that determines a position; keeps the others finite.
        information[_X, _X] += 1 / self._range(state) ** 2
        information[_Y, _Y] += 1 / self._range(state) ** 2
        cost = (residual**2).sum(axis=0) + (pull * state[:3]).sum(axis=0) + bell * off_heading**2
        return cost, information, gradient

    def _step(
        self, state: np.ndarray, information: np.ndarray, gradient: np.ndarray, damping: np.ndarray
    ) -> np.ndarray:
        damped = information.copy()
        for i in range(_N):
            damped[i, i] *= 1 + damping
        step = solve(cholesky(damped), gradient)
        step[:4] = np.clip(step[:4], -_LARGEST_STEP[:, None, None], _LARGEST_STEP[:, None, None])
        length = np.hypot(step[_X], step[_Y])
        step[_X:] *= np.minimum(1.0, 0.4 * self._range(state) / np.maximum(length, 1e-9))
        return step

    def _fits(self, state: np.ndarray, cost: np.ndarray) -> Fits:
        _, information, _ = self._linearise(state, seen_only=True)
        lower = cholesky(information)
        log_root = sum(np.log(lower[i, i]) for i in range(_N))
        log_weight = self._bells.log_weight - cost / 2 - log_root
        before = self._outline.depth(state) > _MIN_DEPTH_M
        log_weight[~(before & self._valid[:, None])] = -np.inf
        return Fits(
            pose=state[_HEADING:],
            # The last block of the factor is that of their information, the others marginalised.
            covariance=_covariance(lower[_HEADING:, _HEADING:]),
            log_size=state[:3],
            size_covariance=_covariance(lower),
            log_weight=log_weight,
            cost=cost,
            range_m=self._range(state),
        )


def cholesky(matrix: np.ndarray) -> np.ndarray:
    """Lower Cholesky factors of many small symmetric matrices (k, k, ...); reads the lower half.

    Loops over the small axes, because LAPACK's overhead per call would dominate.
    """
    lower = np.zeros_like(matrix)
    for j in range(len(matrix)):
        pivot = matrix[j, j] - (lower[j, :j] ** 2).sum(axis=0)
        lower[j, j] = np.sqrt(np.maximum(pivot, 1e-12 * matrix[j, j] + 1e-300))
        for i in range(j + 1, len(matrix)):
            dot = (lower[i, :j] * lower[j, :j]).sum(axis=0)
            lower[i, j] = (matrix[i, j] - dot) / lower[j, j]
    return lower


def solve(lower: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (k, ...) of ``L Lᵀ x = right`` for the factors of :func:`cholesky`."""
    x = right.copy()
    for i in range(len(x)):
        x[i] = (x[i] - (lower[i, :i] * x[:i]).sum(axis=0)) / lower[i, i]
    for i in reversed(range(len(x))):
        x[i] = (x[i] - (lower[i + 1 :, i] * x[i + 1 :]).sum(axis=0)) / lower[i, i]
    return x


def _covariance(lower: np.ndarray) -> np.ndarray:
    """Covariance (3, 3, n, m) of the first three unknowns, the others marginalised."""
    columns = []
    for j in range(3):
        unit = np.zeros_like(lower[0])
        unit[j] = 1.0
        columns.append(solve(lower, unit)[:3])
    return np.stack(columns, axis=1)
