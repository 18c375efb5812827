"""Many cameras at once, each one camera height above the ground: what they see of points, with the
derivatives by the points. Leading axes of arrays are k cameras, n things.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import CENTRE, CORNER, FOCAL, ROLL, TILT
from scene4d.calibration._body import undistort as straighten

NEAREST = 0.02
"""Least depth of a point, in camera heights: what is nearer is not in front of the camera."""


@dataclass(frozen=True, eq=False)
class View:
    """k cameras, one camera height above the ground."""

    focal: np.ndarray
    corner: np.ndarray
    centre: np.ndarray
    R: np.ndarray

    @classmethod
    def of(cls, parameters: Float[np.ndarray, "k 7"]) -> "View":
        """The cameras of parameter vectors."""
        ct, st = np.cos(parameters[:, TILT]), np.sin(parameters[:, TILT])
        cr, sr = np.cos(parameters[:, ROLL]), np.sin(parameters[:, ROLL])
        R = np.empty((len(parameters), 3, 3))
        R[:, 0] = np.stack([cr, sr * st, sr * ct], axis=-1)
        R[:, 1] = np.stack([sr, -cr * st, -cr * ct], axis=-1)
        R[:, 2] = np.stack([np.zeros_like(ct), ct, -st], axis=-1)
        return cls(np.exp(parameters[:, FOCAL]), parameters[:, CORNER], parameters[:, CENTRE], R)

    def on_plane(
        self, uv: Float[np.ndarray, "*k n 2"], z: Float[np.ndarray, "k n"]
    ) -> tuple[Float[np.ndarray, "k n 2"], Bool[np.ndarray, "k n"]]:
        """Where rays meet the plane at height z; false where they do not."""
        uv = np.broadcast_to(uv, (len(self.focal), *uv.shape[-2:])) - self.centre[:, None]
        if self.corner.any():
            uv = np.stack(
                [straighten(p.T, float(c))[0].T for p, c in zip(uv, self.corner, strict=True)]
            )
        ray = np.concatenate([uv / self.focal[:, None, None], np.ones((*uv.shape[:2], 1))], -1)
        ray = ray @ self.R
        valid = (ray[..., 2] < -1e-6) & (z < 1)
        reach = np.where(valid, (1 - z) / np.where(valid, -ray[..., 2], 1.0), 1.0)
        return ray[..., :2] * reach[..., None], valid

    def _flat(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Undistorted image points (k, n, p, 2), centred, and depths."""
        q = (points - [0.0, 0.0, 1.0]) @ np.swapaxes(self.R, -1, -2)[:, None]
        depth = np.maximum(q[..., 2], NEAREST)
        return self.focal[:, None, None, None] * q[..., :2] / depth[..., None], q[..., 2]

    def _gain(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``1 + D r²`` (k, n, p, 1), with r kept where the model is one to one, and D."""
        corner = self.corner[:, None, None, None]
        r2 = (flat**2).sum(axis=-1, keepdims=True)
        fold2 = np.where(corner < 0, 1 / np.maximum(-3 * corner, 1e-12), np.inf)
        return 1 + corner * np.minimum(r2, fold2), corner

    def project(self, points: Float[np.ndarray, "k n p 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Image points (k, n, p, 2) and depths (k, n, p)."""
        flat, depth = self._flat(points)
        return flat * self._gain(flat)[0] + self.centre[:, None, None], depth

    def slopes(
        self, points: Float[np.ndarray, "k n 4 3"], axis: Float[np.ndarray, "n 4 2"]
    ) -> Float[np.ndarray, "k n 4 3"]:
        """Derivatives, by the points, of their images along ``axis``."""
        flat, depth = self._flat(points)
        gain, corner = self._gain(flat)
        by_flat = gain * axis + 2 * corner * (axis * flat).sum(axis=-1, keepdims=True) * flat
        by_depth = -(by_flat * flat).sum(axis=-1, keepdims=True)
        by_q = np.concatenate([self.focal[:, None, None, None] * by_flat, by_depth], axis=-1)
        return (by_q / np.maximum(depth, NEAREST)[..., None]) @ self.R[:, None]
