"""How far a site is from the truth: between each two cameras, and where people are put."""

from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.geometry import rigid_fit
from scene4d.core.placement import PLACED, Placement
from scene4d.store.fusing import fused
from scene4d.store.site import Site

_WITHIN_95 = 7.815
"""95 % of chi-squared with three degrees of freedom: position and heading."""
_Z95 = 1.959964
_STEP_S = 0.2
_MOST_POINTS = 500


@dataclass(frozen=True)
class PairError:
    """What is wrong with camera b as seen from camera a: distance of its position (m), heading
    (degrees), time offset (s; None where the true one is not known), with standard deviations, and
    whether the errors lie within what the site says with 95 %.
    """

    a: str
    b: str
    position_error_m: float
    position_sigma_m: float
    heading_error_deg: float
    heading_sigma_deg: float
    offset_error_s: float
    offset_sigma_s: float
    pose_within_95: bool
    offset_within_95: bool

    def to_dict(self) -> dict[str, Any]:
        """Content of ``evaluation.json``."""
        said = asdict(self)
        return {"cameras": [said.pop("a"), said.pop("b")]} | said


@dataclass(frozen=True, eq=False)
class Agreement:
    """Distances (m) between where two cameras put one person at one moment, by pair."""

    distance_m: Float[np.ndarray, "n"]
    people: int


@dataclass(frozen=True)
class GroundError:
    """Mean errors (m) of ground points where people walked, after the best rigid motion: of the
    whole site at once, and camera by camera as refined by the site and as each was alone.
    """

    site_m: float
    refined_m: float
    alone_m: float


def true_placement(camera: Camera, offset_s: float = 0.0) -> Placement:
    """Where the ground of a camera (origin below it, +Y ahead) lies in its true world."""
    ahead, (x, y) = camera.R[2, :2], camera.centre_m[:2].tolist()
    return Placement(x, y, float(np.arctan2(-ahead[0], ahead[1])), 1.0, offset_s)


def pair_errors(
    site: Site, true: dict[str, Camera], offsets_s: dict[str, float]
) -> list[PairError]:
    """Every two cameras that have a place and a truth."""
    there = [name for name in site.cameras if name in true]
    return [_pair_error(site, a, b, true, offsets_s) for a, b in combinations(there, 2)]


def _pair_error(
    site: Site, a: str, b: str, true: dict[str, Camera], offsets_s: dict[str, float]
) -> PairError:
    found, slopes = _relative(site.placements[a], site.placements[b])
    covariance = slopes @ _together(site, a, b) @ slopes.T
    real, _ = _relative(
        true_placement(true[a], offsets_s.get(a, 0.0)),
        true_placement(true[b], offsets_s.get(b, 0.0)),
    )
    apart = found - real
    apart[2] = np.angle(np.exp(1j * apart[2]))
    pose, sigma = covariance[:3, :3] + 1e-12 * np.eye(3), np.sqrt(np.diag(covariance))
    return PairError(
        a,
        b,
        float(np.hypot(*apart[:2])),
        float(np.hypot(*sigma[:2])),
        float(np.degrees(abs(apart[2]))),
        float(np.degrees(sigma[2])),
        float(abs(apart[3])),
        float(sigma[3]),
        bool(apart[:3] @ np.linalg.solve(pose, apart[:3]) <= _WITHIN_95),
        bool(abs(apart[3]) <= _Z95 * sigma[3] + 1e-9),
    )


def _relative(
    a: Placement, b: Placement
) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "4 10"]]:
    """Position (m of the site), heading and offset of b as seen from a, and their derivatives by
    the two placements.
    """
    c, s = np.cos(a.heading_rad), np.sin(a.heading_rad)
    back = np.array([[c, s], [-s, c]])
    step = back @ np.array([b.x_m - a.x_m, b.y_m - a.y_m])
    turn, later = b.heading_rad - a.heading_rad, b.time_offset_s - a.time_offset_s
    of_b = np.zeros((4, 5))
    of_b[:2, :2], of_b[2, 2], of_b[3, 4] = back, 1.0, 1.0
    of_a = -of_b
    of_a[:2, 2] = step[1], -step[0]
    return np.array([*step, turn, later]), np.hstack([of_a, of_b])


def _together(site: Site, a: str, b: str) -> Float[np.ndarray, "10 10"]:
    """Covariance of two placements; independent where the site does not tell more."""
    size, errors = len(PLACED), site.errors
    found = np.zeros((2 * size, 2 * size))
    for row, one in enumerate((a, b)):
        for column, other in enumerate((a, b)):
            here = np.s_[row * size : (row + 1) * size, column * size : (column + 1) * size]
            if errors is not None:
                found[here] = errors.of(one, other)[:size, :size]
            elif one == other:
                found[here] = site.placements[one].covariance
    return found


def agreement(site: Site) -> Agreement:
    """Where cameras put the same people at the same moments."""
    seen = {
        name: fused([site.camera_tracks(name, keypoints=False)], _STEP_S) for name in site.cameras
    }
    distances, people = [np.zeros(0)], set[int]()
    for a, b in combinations(seen, 2):
        one, other = seen[a], seen[b]
        keys = [np.column_stack([t.track, t.frame]) for t in (one, other)]
        low = min(key[:, 1].min(initial=0) for key in keys)
        wide = max(key[:, 1].max(initial=0) for key in keys) - low + 1
        flat = [key[:, 0] * wide + key[:, 1] - low for key in keys]
        _, i, j = np.intersect1d(*flat, return_indices=True)
        distances.append(np.hypot(*(one.xy_m[i] - other.xy_m[j]).T))
        people |= set(one.track[i].tolist())
    return Agreement(np.concatenate(distances), len(people))


def ground_error(site: Site, true: dict[str, Camera]) -> GroundError | None:
    """Errors on the ground where people walked; None where there is no truth or nobody."""
    found, real, refined, alone = [], [], [], []
    for name in [name for name in site.cameras if name in true]:
        here = site.camera_tracks(name, keypoints=False).xy_m
        here = here[np.isfinite(here).all(axis=1)]
        here = here[:: max(1, len(here) // _MOST_POINTS)]
        uv, seen = site.camera(name).project(np.column_stack([here, np.zeros(len(here))]))
        there, valid = true[name].locate(uv)
        before = site.scene_calibration(name).camera
        assert before is not None
        own, known = before.locate(uv)
        rows = seen & valid & known
        if rows.sum() < 3:
            continue
        found.append(here[rows])
        real.append(there[rows])
        refined.append(_apart(here[rows], there[rows]))
        alone.append(_apart(own[rows], there[rows]))
    if not found:
        return None
    whole = _apart(np.concatenate(found), np.concatenate(real))
    return GroundError(
        float(whole.mean()),
        float(np.concatenate(refined).mean()),
        float(np.concatenate(alone).mean()),
    )


def _apart(
    found: Float[np.ndarray, "n 2"], real: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n"]:
    """Distances after the rigid motion that brings points nearest to the truth."""
    R, shift = rigid_fit(found, real)
    return np.hypot(*(found @ R.T + shift - real).T)


def aligned_truth(site: Site, true: dict[str, Camera]) -> dict[str, Camera]:
    """True cameras in the site's frame: moved rigidly so that positions and headings fit best."""
    there = [name for name in site.cameras if name in true]
    if not there:
        return {}
    ends = [_ends(site.camera(name)) for name in there], [_ends(true[name]) for name in there]
    R, shift = rigid_fit(np.concatenate(ends[1]), np.concatenate(ends[0]))
    heading = float(np.arctan2(R[1, 0], R[0, 0]))
    frame = Placement(float(shift[0]), float(shift[1]), heading, 1.0, 0.0)
    return {name: frame.camera(true[name]) for name in there}


def _ends(camera: Camera) -> Float[np.ndarray, "2 2"]:
    """Where a camera is, and a point some metres ahead."""
    ahead = camera.R[2, :2] / max(float(np.hypot(*camera.R[2, :2])), 1e-9)
    return np.array([camera.centre_m[:2], camera.centre_m[:2] + 5 * ahead])
