"""Tracks on the ground of another calibration of the same camera, and on that of a site."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from scene4d.core.calibration import Calibration
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks

_STEP_M = 0.01
"""Half a width of the differences that give a derivative; lens and perspective are straight over a
centimetre."""


def regrounded(tracks: Tracks, before: Calibration, after: Calibration) -> Tracks:
    """What stood on the ground of the camera ``before``, seen at the same pixels by ``after``.

    The shared covariance becomes that of ``after``; NaN where it sees no ground.
    """
    xy, uv = _moved(tracks.xy_m, before, after)
    steps = _STEP_M * np.array([[1.0, 0.0], [0.0, 1.0]])
    columns = [
        (_moved(tracks.xy_m + d, before, after)[0] - _moved(tracks.xy_m - d, before, after)[0])
        / (2 * _STEP_M)
        for d in steps
    ]
    J = np.stack(columns, axis=-1)
    ahead = np.stack([np.cos(tracks.heading_rad), np.sin(tracks.heading_rad)], axis=-1)
    ahead = np.einsum("nij,nj->ni", J, ahead)
    shared = tracks.shared_covariance_m2
    if after.covariance is not None:
        shared, _ = after.ground_covariance(uv, from_camera=True)
    return replace(
        tracks,
        xy_m=xy,
        covariance_m2=J @ tracks.covariance_m2 @ J.swapaxes(1, 2),
        shared_covariance_m2=shared,
        velocity_mps=np.einsum("nij,nj->ni", J, tracks.velocity_mps),
        velocity_covariance=J @ tracks.velocity_covariance @ J.swapaxes(1, 2),
        heading_rad=np.arctan2(ahead[:, 1], ahead[:, 0]),
    )


def in_site(
    tracks: Tracks, placement: Placement, modes_m: Float[np.ndarray, "n 2 r"] | None = None
) -> Tracks:
    """Tracks of a camera on its clock, in the site's frame and on the site's clock.

    ``modes_m`` (:meth:`.SiteErrors.modes_m`) is how place and calibration, which err together, move
    each row: by less than each by itself would make it, as it is taken without them.
    """
    velocity = np.nan_to_num(tracks.velocity_mps)
    drifting = placement.drifting_covariances(velocity, tracks.time_s)
    if modes_m is None:
        placed = placement.point_covariances(tracks.xy_m, velocity) + drifting
        shared = placement.own_covariances(tracks.shared_covariance_m2) + placed
    else:
        shared = modes_m @ modes_m.swapaxes(1, 2) + drifting
    own_velocity = placement.own_covariances(tracks.velocity_covariance)
    return replace(
        tracks,
        time_s=placement.times(tracks.time_s),
        xy_m=placement.points(tracks.xy_m),
        covariance_m2=placement.own_covariances(tracks.covariance_m2),
        shared_covariance_m2=shared,
        velocity_mps=placement.velocities(tracks.velocity_mps),
        velocity_covariance=own_velocity + placement.velocity_covariances(velocity),
        heading_rad=placement.headings(tracks.heading_rad),
        heading_sigma_rad=placement.heading_sigmas(tracks.heading_sigma_rad),
        z_m=placement.scale * tracks.z_m,
        z_sigma_m=placement.scale * tracks.z_sigma_m,
        size_m=placement.scale * tracks.size_m,
        size_sigma_m=placement.scale * tracks.size_sigma_m,
    )


def _moved(
    xy_m: Float[np.ndarray, "n 2"], before: Calibration, after: Calibration
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Ground points of ``after`` at the pixels where ``before`` shows those of its own."""
    uv, _ = before.ground_pixels(xy_m)
    assert after.camera is not None
    xy, _ = after.camera.locate(uv, after.ground_height_m(uv)[0])
    return xy, uv
