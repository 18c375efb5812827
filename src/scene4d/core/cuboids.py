"""Objects as upright cuboids on the ground: their centres, corners and errors."""

import numpy as np
from jaxtyping import Float

from scene4d.core._ground_jacobian import ground_jacobian
from scene4d.core.calibration import Calibration
from scene4d.core.tracks import Tracks
from scene4d.core.vehicle_shapes import CUBOID


def centroids(
    tracks: Tracks,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Middles (m) of people and vehicles, half their height above the ground, and covariances
    (m²) that include the camera's error; NaN without a position or a height.
    """
    height_m, sigma_m = tracks.size_m[:, 2], tracks.size_sigma_m[:, 2]
    covariance = np.zeros((len(tracks), 3, 3))
    covariance[:, :2, :2] = tracks.covariance_m2 + tracks.shared_covariance_m2
    covariance[:, 2, 2] = tracks.z_sigma_m**2 + (sigma_m / 2) ** 2
    xyz_m = np.column_stack([tracks.xy_m, tracks.z_m + height_m / 2])
    unknown = ~np.isfinite(xyz_m).all(axis=1)
    xyz_m[unknown], covariance[unknown] = np.nan, np.nan
    return xyz_m, covariance


def cuboid_covariance(tracks: Tracks) -> Float[np.ndarray, "n 7 7"]:
    """Covariance of cuboids: x, y, z of the centre (m), heading (rad), length, width and height
    (m). Position on the ground, heading and sizes are taken as independent of one another. The
    variance of a heading is NaN where only its axis is known, and all is without a position.
    """
    covariance = np.zeros((len(tracks), 7, 7))
    covariance[:, :3, :3] = centroids(tracks)[1]
    sizes = tracks.size_sigma_m**2
    for number, variance in enumerate((tracks.heading_sigma_rad**2, *sizes.T), start=3):
        covariance[:, number, number] = variance
    covariance[:, 2, 6] = covariance[:, 6, 2] = sizes[:, 2] / 2  # a taller one has a higher centre
    covariance[np.isnan(covariance[:, 0, 0])] = np.nan
    return covariance


def cuboid_corners(tracks: Tracks) -> Float[np.ndarray, "n 8 3"]:
    """Corners (m) of vehicles' cuboids, in the order of :data:`.CUBOID`; NaN where the position,
    the heading or a size is unknown.
    """
    c, s = np.cos(tracks.heading_rad), np.sin(tracks.heading_rad)
    local = CUBOID * tracks.size_m[:, None]
    x = local[..., 0] * c[:, None] - local[..., 1] * s[:, None]
    y = local[..., 0] * s[:, None] + local[..., 1] * c[:, None]
    foot = np.column_stack([tracks.xy_m, tracks.z_m])
    corners: np.ndarray = foot[:, None] + np.stack([x, y, local[..., 2]], axis=-1)
    corners[~np.isfinite(corners).all(axis=(1, 2))] = np.nan
    return corners


def size_jacobian(
    calibration: Calibration,
    size_m: Float[np.ndarray, "t 3"],
    xyz_m: Float[np.ndarray, "t 3"],
    heading_rad: Float[np.ndarray, "t"],
) -> Float[np.ndarray, "t 3 7"]:
    """Derivatives of lengths, widths and heights, as they are seen from fixed pixels, with respect
    to :data:`.PARAMETERS`; NaN where a camera does not see the ends.
    """
    camera = calibration.camera
    assert camera is not None

    def moved(xyz: np.ndarray) -> np.ndarray:
        return ground_jacobian(camera, camera.project(xyz)[0], xyz[:, 2])[1]

    found = np.empty((*size_m.shape, 7))
    ahead = np.stack([np.cos(heading_rad), np.sin(heading_rad), np.zeros(len(size_m))], axis=1)
    ahead = np.nan_to_num(ahead)
    for axis, unit in enumerate((ahead, ahead[:, [1, 0, 2]] * (-1, 1, 1))):
        half = unit * size_m[:, axis, None] / 2
        apart = moved(xyz_m + half) - moved(xyz_m - half)
        found[:, axis] = np.einsum("ti,tip->tp", unit[:, :2], apart)
    top = xyz_m + size_m[:, 2:] * (0.0, 0.0, 1.0)
    with np.errstate(all="ignore"):
        w = (top - camera.centre_m)[:, :2] / (top - camera.centre_m)[:, 2:]
        along = w / (w**2).sum(axis=1)[:, None]
    found[:, 2] = np.einsum("ti,tip->tp", along, moved(xyz_m) - moved(top))
    return found
