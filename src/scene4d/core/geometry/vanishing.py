"""Vanishing points of upright segments, and the orientation that they imply."""

import numpy as np
from jaxtyping import Float


def meeting_point(
    start_uv: Float[np.ndarray, "n 2"],
    end_uv: Float[np.ndarray, "n 2"],
    weight: Float[np.ndarray, "n"] | None = None,
) -> Float[np.ndarray, "3"]:
    """Homogeneous point nearest to all lines through the segments (weighted algebraic fit).

    The lines are normalised in coordinates centred and scaled to the points (Hartley 1997), so
    that the answer does not depend on the pixel unit. Raises ``ValueError`` below two segments.
    """
    if len(start_uv) < 2:
        raise ValueError(f"a vanishing point needs at least 2 segments, found {len(start_uv)}")
    both = np.vstack([start_uv, end_uv])
    centre, scale = both.mean(axis=0), max(float(np.ptp(both, axis=0).max()), 1e-12)
    a, b = (start_uv - centre) / scale, (end_uv - centre) / scale
    lines = np.column_stack(
        [a[:, 1] - b[:, 1], b[:, 0] - a[:, 0], a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]]
    )
    lines /= np.maximum(np.hypot(lines[:, 0], lines[:, 1]), 1e-12)[:, None]
    if weight is not None:
        lines = lines * np.sqrt(weight)[:, None]
    point = np.linalg.eigh(lines.T @ lines)[1][:, 0]
    return np.array(
        [point[0] * scale + point[2] * centre[0], point[1] * scale + point[2] * centre[1], point[2]]
    )


def tilt_roll_from_vertical(
    vanishing_point: Float[np.ndarray, "3"], focal_px: float, centre_uv: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """Tilt and roll (radians) of the camera that sees verticals meet at this point.

    The point is the image of the nadir, so ``K⁻¹ vvp`` is the down direction in camera
    coordinates up to sign; the sign is the one that keeps the image upright.
    """
    down = np.array(
        [
            (vanishing_point[0] - vanishing_point[2] * centre_uv[0]) / focal_px,
            (vanishing_point[1] - vanishing_point[2] * centre_uv[1]) / focal_px,
            vanishing_point[2],
        ]
    )
    down /= np.linalg.norm(down)
    if down[1] < 0:
        down = -down
    return float(np.arcsin(np.clip(down[2], -1, 1))), float(np.arctan2(-down[0], down[1]))
