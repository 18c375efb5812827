"""The frame of a site tied to what is known: points of Earth or plan, lines of a map, cameras."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.alignment._lines import SCALE_SIGMA, on_lines
from scene4d.core.calibration import Calibration
from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.geometry import rigid_fit
from scene4d.core.placement import Placement
from scene4d.core.text import nearest
from scene4d.core.tracks import Tracks
from scene4d.formats.anchors import Anchors
from scene4d.store.regrounding import in_site
from scene4d.store.site_errors import SiteErrors
from scene4d.store.site_file import SiteAnchor

_SIGMA_M = {"earth": 1.0, "plan": 0.2, "cameras": 0.1}
"""How far off an anchor is (m): read off an aerial photograph, off a plan, measured. Chosen."""
_CLOCK_SIGMA_S = 1.0
"""Clocks that are said to be UTC agree within about this. Chosen: network time, rounded starts."""
_LEAST_SPREAD_M = 1.0
_WARN_AT, _REFUSE_AT = 3.0, 6.0
"""Distance of a point from where the anchors put it, in expected errors."""
_SAMPLES = 40
_STEPS = 10


@dataclass(frozen=True, eq=False)
class Anchored:
    """A camera that can be anchored: its calibration, its place in the site so far, what it
    tracked on the ground of that calibration, and whether its clock is known.
    """

    calibration: Calibration
    placement: Placement
    tracks: Tracks | None
    start_known: bool


@dataclass(frozen=True, eq=False)
class _Points(Columns):
    """Ground points as the site has them, with covariances, and where they really are."""

    xy_m: Float[np.ndarray, "n 2"]
    covariance: Float[np.ndarray, "n 2 2"]
    true_m: Float[np.ndarray, "n 2"]


def tied(
    cameras: Mapping[str, Anchored], anchors: Anchors, errors: SiteErrors
) -> tuple[dict[str, Placement], SiteAnchor, SiteErrors]:
    """Placements in the anchors' frame, of cameras that only an anchor places too, and what all
    err by together there; ``errors`` is that of the cameras which have a place before.

    Lines of a map may leave it undetermined, which the anchor says; all stays as it is then.
    Raises :class:`InputError` for a camera that is not there, a pixel that does not lie on the
    ground, fewer than two points for the whole site, and points that contradict each other.
    """
    before = {name: one.placement for name, one in cameras.items()}
    if anchors.lines:
        frame, own = _kept_to(cameras, anchors, errors)
        residuals: list[float] = []
    else:
        frame, own, residuals = _by_points(cameras, anchors)
    if frame is not None and not frame:
        return before, SiteAnchor("earth", reason=frame.reason), errors
    found = {name: one.then(frame) if one and frame else one for name, one in before.items()} | own
    errors = errors if frame is None else errors.then(frame, before)
    for name, one in own.items():
        if one:
            errors = errors.beside(SiteErrors.alone(name, one, cameras[name].calibration))
    if not any(found.values()):
        return (
            found,
            SiteAnchor(anchors.kind, reason=str(next(iter(found.values())).reason)),
            errors,
        )
    place = anchors.latitude_deg, anchors.longitude_deg
    return found, SiteAnchor(anchors.kind, tuple(residuals), *place), errors


def _by_points(
    cameras: Mapping[str, Anchored], anchors: Anchors
) -> tuple[Placement | None, dict[str, Placement], list[float]]:
    """Where the site lies by points, the places of cameras that only points tell, and how far each
    point is from where all put it.
    """
    _check_names(cameras, anchors)
    points = {name: _points_of(name, one, anchors) for name, one in cameras.items()}
    placed = [name for name, one in cameras.items() if one.placement]
    seen = [_in_site(points[name], cameras[name].placement) for name in placed]
    together = _Points.joined(seen) if seen else _NOBODY
    frame, residuals = None, list[float]()
    if placed and _spread(together) >= _LEAST_SPREAD_M:
        frame, residuals = _fit(together, _SIGMA_M[anchors.kind])
    elif placed:
        raise InputError(
            f"anchor: {len(together)} points of the cameras {', '.join(placed)} do not tie the "
            "site; give two or more, far apart"
        )
    own = {}
    for name, one in cameras.items():
        if not one.placement and _spread(points[name]) >= _LEAST_SPREAD_M:
            place, residual = _fit(points[name], _SIGMA_M[anchors.kind])
            residuals += residual
            own[name] = _by_clock(place, one)
    return frame, own, residuals


def _kept_to(
    cameras: Mapping[str, Anchored], anchors: Anchors, errors: SiteErrors
) -> tuple[Placement | None, dict[str, Placement]]:
    """Where the site lies if tracks keep to the lines of a map, and cameras that share nobody."""
    told = {name: one.tracks for name, one in cameras.items() if one.tracks is not None}
    placed = [name for name in told if cameras[name].placement]
    frame = None
    if placed:
        seen = [in_site(told[name], cameras[name].placement) for name in placed]
        frame = on_lines(
            seen, [_modes(told[k], k, cameras[k], errors) for k in placed], anchors.lines
        )
        if not frame:
            return frame, {}
    own = {}
    for name, tracks in told.items():
        if name in placed:
            continue
        one = replace(cameras[name], placement=Placement.identity())
        alone = SiteErrors.alone(name, one.placement, one.calibration)
        place = on_lines([tracks], [_modes(tracks, name, one, alone)], anchors.lines)
        if place:
            own[name] = _by_clock(place, one)
        else:
            why = f"{cameras[name].placement.reason}; and by the map, {place.reason}"
            own[name] = Placement.undetermined(why)
    return frame, own


def _modes(
    tracks: Tracks, name: str, one: Anchored, errors: SiteErrors
) -> Float[np.ndarray, "n 2 r"]:
    """How the site's errors move a camera's tracks there."""
    return np.nan_to_num(errors.modes_m(name, one.placement, one.calibration, tracks.xy_m))


def _check_names(cameras: Mapping[str, Anchored], anchors: Anchors) -> None:
    for name in (*anchors.camera, *anchors.known):
        if name not in cameras:
            raise InputError(f"anchor: no camera {name!r} in the site{nearest(name, cameras)}")


def _points_of(name: str, one: Anchored, anchors: Anchors) -> _Points:
    """On the camera's own ground, with the errors of its calibration."""
    rows = [k for k, camera in enumerate(anchors.camera) if camera == name]
    uv, true = anchors.uv[rows], anchors.xy_m[rows]
    if name in anchors.known and one.tracks is not None:
        there, _ = one.calibration.ground_pixels(_sample(one.tracks))
        real, seen = anchors.known[name].locate(there)
        uv, true = np.vstack([uv, there[seen]]), np.vstack([true, real[seen]])
    camera = one.calibration.camera
    assert camera is not None
    xy, valid = camera.locate(uv)
    if not valid[: len(rows)].all():
        u, v = uv[int(np.argmin(valid))]
        raise InputError(
            f"anchor: pixel ({u:g}, {v:g}) of camera {name!r} does not lie on the ground; give "
            "pixels below the horizon"
        )
    covariance = np.zeros((len(uv), 2, 2))
    if one.calibration.covariance is not None:
        covariance, _ = one.calibration.ground_covariance(uv, from_camera=True)
    return _Points(xy[valid], covariance[valid], true[valid])


def _sample(tracks: Tracks) -> Float[np.ndarray, "n 2"]:
    """Places where people walked, all over them."""
    known = tracks.xy_m[np.isfinite(tracks.xy_m).all(axis=1)]
    order = np.lexsort(np.round(known).T)
    return known[order[:: max(1, len(order) // _SAMPLES)]]


def _in_site(points: _Points, placement: Placement) -> _Points:
    covariance = placement.own_covariances(points.covariance)
    covariance = covariance + placement.point_covariances(points.xy_m)
    return _Points(placement.points(points.xy_m), covariance, points.true_m)


_NOBODY = _Points(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty((0, 2)))


def _spread(points: _Points) -> float:
    """The largest distance of two points; 0 for fewer."""
    if len(points) < 2:
        return 0.0
    apart = points.xy_m[:, None] - points.xy_m[None]
    return float(np.hypot(apart[..., 0], apart[..., 1]).max())


def _fit(points: _Points, sigma_m: float) -> tuple[Placement, list[float]]:
    """Where the points' frame lies in the anchors': least squares over shift, turn and scale.

    The covariance is widened by what the residuals are larger than expected.
    """
    R, shift = rigid_fit(points.xy_m, points.true_m)
    at = np.array([*shift, np.arctan2(R[1, 0], R[0, 0]), 0.0, 0.0])
    prior = np.diag([0.0, 0.0, 0.0, SCALE_SIGMA**-2])
    information = np.eye(4)
    for _ in range(_STEPS):
        frame = Placement.from_parameters(at, np.zeros((5, 5)))
        spread = frame.own_covariances(points.covariance) + sigma_m**2 * np.eye(2)
        weight = np.linalg.inv(spread)
        apart = points.true_m - frame.points(points.xy_m)
        J = frame.point_jacobian(points.xy_m)[:, :, :4]
        information = np.einsum("nia,nij,njb->ab", J, weight, J) + prior
        force = np.einsum("nia,nij,nj->a", J, weight, apart) - prior @ at[:4]
        at[:4] += np.linalg.solve(information, force)
    residual = np.hypot(*apart.T)
    _check_residuals(residual / np.sqrt(np.trace(spread, axis1=1, axis2=2)), residual)
    chi2 = float(np.einsum("ni,nij,nj->", apart, weight, apart)) / max(2 * len(points) - 4, 1)
    covariance = np.zeros((5, 5))
    covariance[:4, :4] = np.linalg.inv(information) * max(1.0, chi2)
    return Placement.from_parameters(at, covariance), residual.tolist()


def _check_residuals(ratio: Float[np.ndarray, "n"], residual: Float[np.ndarray, "n"]) -> None:
    worst = int(np.argmax(ratio))
    if ratio[worst] <= _WARN_AT:
        return
    text = (
        f"anchor: point {worst + 1} lies {residual[worst]:.1f} m from where the points together "
        f"put it, {ratio[worst]:.0f} times as far as expected; does its place belong to it?"
    )
    if ratio[worst] > _REFUSE_AT:
        raise InputError(text)
    warnings.warn(text, stacklevel=2)


def _by_clock(place: Placement, one: Anchored) -> Placement:
    """A place that only anchors give, with the clock as it is, if it is known."""
    if not one.start_known:
        return Placement.undetermined(
            "its place is anchored, but its clock is not known: it shares nobody with another "
            "camera, and the start of its footage is not given; track again with its start"
        )
    covariance = place.covariance.copy()
    covariance[4, 4] = _CLOCK_SIGMA_S**2
    return replace(place, covariance=covariance)
