"""``solve_camera``: from the feet and heads of people to the camera that sees them."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration import verdict
from scene4d.calibration.body import FOCAL, HEIGHT
from scene4d.calibration.frame import ImageFrame
from scene4d.calibration.joint import position_weights, solve
from scene4d.calibration.lines import Lines
from scene4d.calibration.paper import solve_paper
from scene4d.calibration.prior import default_prior
from scene4d.calibration.refine import HEIGHT_SIGMA_M, Problem, State, linearise
from scene4d.calibration.uncertainty import covariance, systematic_covariance
from scene4d.errors import InputError
from scene4d.geometry import locate, project
from scene4d.model import Calibration, Lens, Orientation, Segments

METHODS = ("joint", "paper")
GROUND_SAMPLE = 300
"""So many feet are enough to tell the typical error of the ground."""
TRACK_CORRELATION = 0.12
"""Of one person's errors across the body in different places (gait, posture); PETS has 0.11
(benchmarks/keypoint_bias.py)."""


def solve_camera(
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    *,
    image_size: tuple[int, int],
    person_height_m: float = 1.70,
    foot_height_m: float = 0.04,
    track: Int[np.ndarray, "n"] | None = None,
    prior: Orientation | None = None,
    method: str = "joint",
) -> Calibration:
    """The camera that sees upright people with these feet and heads (undistorted pixels).

    ``method="joint"`` estimates focal length, tilt, roll and height together; ``prior`` may tell
    what is known of the first three beforehand. ``method="paper"`` takes them from ``prior`` and
    solves for the height alone (Wagner et al. 2019). ``person_height_m`` is the mean height of
    the population, and all uncertainties are conditional on it; ``foot_height_m`` is the height
    of the foot points above the ground. ``track`` says which rows are one person (-1: unknown).

    Returns a :class:`Calibration`, false with a reason where the camera is undetermined. Raises
    :class:`InputError` for arrays that are no points, and for the paper's method without prior.
    """
    foot, head = np.asarray(foot_uv, float), np.asarray(head_uv, float)
    for name, points in (("foot_uv", foot), ("head_uv", head)):
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError(f"{name} must be an (n, 2) array, found shape {points.shape}")
        if not np.isfinite(points).all():
            row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
            raise InputError(f"{name} row {row} is not finite: drop people without that point")
    if len(foot) != len(head) or (track is not None and len(track) != len(foot)):
        raise InputError("foot_uv, head_uv and track must have one row per person")
    segments = Segments.from_points(foot, head, track=track)
    return solve_segments(
        segments,
        image_size=image_size,
        person_height_m=person_height_m,
        foot_height_m=foot_height_m,
        orientation=prior,
        method=method,
        estimate_distortion=False,
    )


def solve_segments(
    segments: Segments,
    *,
    image_size: tuple[int, int],
    person_height_m: float = 1.70,
    foot_height_m: float = 0.04,
    orientation: Orientation | None = None,
    method: str = "joint",
    lens: Lens | None = None,
    estimate_focal: bool = False,
    estimate_distortion: bool = True,
    lines_xyxy: Float[np.ndarray, "m 4"] | None = None,
    population_sigma_m: float = 0.0,
    systematics: bool = False,
    consensus: str = "exact",
    seed: int = 0,
) -> Calibration:
    """As :func:`solve_camera`, on segments in pixels of the footage and with all that is known.

    A ``lens`` undistorts and fixes the focal length, unless ``estimate_focal``; without one, a
    radial coefficient is estimated where ``estimate_distortion``. ``lines_xyxy`` are straight
    edges of the scene in the same pixels. ``population_sigma_m`` is how well the mean height of
    the people here is known, and widens the covariance. ``systematics`` is meant for real
    footage: it adds the errors that all people share, and counts a track's places as correlated.
    """
    if method not in METHODS:
        raise InputError(f"method must be one of {METHODS}, found {method!r}")
    if not 0.5 <= person_height_m <= 2.5:
        raise InputError(f"person_height_m must lie in 0.5 to 2.5 metres, found {person_height_m}")
    if not 0 <= foot_height_m < person_height_m / 2:
        raise InputError(f"foot_height_m must lie in 0 to half a person, found {foot_height_m}")
    frame = ImageFrame(image_size, lens)

    def result(status: str, **found: object) -> Calibration:
        known = {"method": method, "image_size": image_size, "person_height_m": person_height_m}
        return Calibration(status=status, segments=segments, **(known | found))  # type: ignore[arg-type]

    points = frame.points(segments, foot_height_m)
    usable = np.isfinite(points.foot).all(axis=0) & np.isfinite(points.head).all(axis=0)
    usable &= np.hypot(*(points.head - points.foot)) > 1e-6
    if usable.sum() < verdict.MIN_PEOPLE:
        return result(
            "undetermined",
            reason=f"{int(usable.sum())} upright people are seen whole, and at least "
            f"{verdict.MIN_PEOPLE} are needed: use more footage, or footage with people in it",
        )
    if method == "paper":
        return _paper(
            segments,
            frame,
            usable,
            orientation,
            person_height_m,
            population_sigma_m,
            consensus,
            seed,
            result,
        )

    prior = default_prior(estimate_distortion=estimate_distortion and lens is None)
    if lens is not None and not estimate_focal:
        prior = prior.with_focal(float(lens.K[0, 0]), frame.half_diagonal_px)
    if orientation is not None:
        prior = prior.with_orientation(orientation, frame.half_diagonal_px)
    if segments.from_box[usable].all() and prior.sigma[FOCAL] > verdict.BOX_FOCAL_SIGMA:
        return result("undetermined", reason=verdict.BOXES_ALONE)
    lines = None
    if lines_xyxy is not None and len(lines_xyxy):
        lines = _lines(frame, lines_xyxy)
    points = points.select(usable)
    track = _renumbered(segments.track[usable])
    length = np.hypot(*(points.head - points.foot))
    correlation = TRACK_CORRELATION if systematics else 0.0
    weight = position_weights(points.foot, length, track, correlation)
    problem = Problem(points, track, weight, person_height_m, prior, lines)
    state = solve(problem, seed=seed)
    if state is None:
        return result("undetermined", reason="no camera above the people explains what is seen")
    return _judged(segments, frame, usable, problem, state, population_sigma_m, systematics, result)


def _renumbered(track: np.ndarray) -> np.ndarray:
    """Tracks as 0..t-1, with a track of its own for every person without one."""
    unknown = track < 0
    own = np.where(unknown, track.max(initial=0) + 1 + np.arange(len(track)), track)
    return np.unique(own, return_inverse=True)[1]


def _lines(frame: ImageFrame, xyxy: np.ndarray) -> Lines:
    ends = xyxy.reshape(-1, 2)
    if frame.lens is not None:
        ends = frame.lens.undistort(ends)[0]
    both = frame.normalised(ends).T.reshape(-1, 4)
    both = both[np.isfinite(both).all(axis=1)]
    unit = frame.half_diagonal_px
    return Lines.from_pixels(both * unit, np.zeros(2), unit)


def _judged(
    segments: Segments, frame: ImageFrame, usable: np.ndarray, problem: Problem, state: State,
    population_sigma_m: float, systematics: bool, result: Callable[..., Calibration],
) -> Calibration:  # fmt: skip
    """The calibration of a solved problem, or its refusal."""
    cov = covariance(problem, state)
    if systematics:
        cov = cov + systematic_covariance(problem, state)
    cov[HEIGHT, HEIGHT] += (population_sigma_m / problem.person_height_m) ** 2
    lin = linearise(problem, state)
    inlier = np.zeros(len(segments), bool)
    inlier[usable] = lin.inlier > 0.5
    camera = frame.camera(state.parameters)
    found = result("ok", camera=camera, covariance=cov, inlier=inlier)
    share = float(inlier[usable].mean())
    ground, relative = _ground_error(found)
    why = verdict.refusal(problem.points, problem.prior, cov, relative, share)
    if why is not None:
        return result("undetermined", reason=why, inlier=inlier)
    noise = state.noise
    residual = np.full(len(segments), np.nan)
    along = np.where(problem.points.from_box, noise.box_along, noise.along)
    along = np.where(problem.lone, np.hypot(along, noise.height_m / problem.person_height_m), along)
    residual[usable] = np.hypot(lin.residual[0] * along, lin.residual[1] * noise.across)
    told = verdict.warnings(
        int(usable.sum()), len(np.unique(problem.track)), share, problem.prior, cov
    )
    return result(
        "ok", camera=camera, covariance=cov, inlier=inlier, residual=residual,
        ground_error_m=ground, warnings=tuple(told),
    )  # fmt: skip


def _ground_error(found: Calibration) -> tuple[dict[str, float], float]:
    """Predicted error where people walked: median and p90 (m) within the scene, and the median
    error from the camera over the distance.
    """
    camera, segments = found.camera, found.segments
    assert camera is not None and segments is not None and found.inlier is not None
    uv = segments.foot_uv[found.inlier]
    uv = uv[:: max(1, len(uv) // GROUND_SAMPLE)]
    xy, seen = camera.locate(camera.undistort(uv)[0])
    uv, xy = uv[seen], xy[seen]
    if len(uv) == 0:
        return {"median": np.inf, "p90": np.inf}, np.inf
    median, p90 = np.quantile(found.ground_sigma_m(uv), [0.5, 0.9])
    distance = np.maximum(np.hypot(*xy.T), 1e-6)
    relative = float(np.median(found.ground_sigma_m(uv, from_camera=True) / distance))
    return {"median": float(median), "p90": float(p90)}, relative


def _paper(
    segments: Segments, frame: ImageFrame, usable: np.ndarray, orientation: Orientation | None,
    person_height_m: float, population_sigma_m: float, consensus: str, seed: int,
    result: Callable[..., Calibration],
) -> Calibration:  # fmt: skip
    if orientation is None:
        raise InputError(
            "the paper's method needs the camera's orientation (focal length, tilt, roll): "
            "give --orientation FILE, or use --method joint"
        )
    focal = orientation.focal_px / frame.half_diagonal_px
    parameters = np.array([np.log(focal), orientation.tilt_rad, orientation.roll_rad, 0.0, 0.0])
    K = frame.camera(parameters).K
    foot, head = segments.foot_uv[usable], segments.head_uv[usable]
    if frame.lens is not None:
        foot, head = frame.lens.undistort(foot)[0], frame.lens.undistort(head)[0]
    try:
        found = solve_paper(
            foot, head, K, orientation,
            person_height_m=person_height_m, person_sigma_m=HEIGHT_SIGMA_M,
            track=segments.track[usable], consensus=consensus, seed=seed,
        )  # fmt: skip
    except InputError as error:
        return result("undetermined", reason=str(error))
    parameters[HEIGHT] = np.log(found.height_m)
    camera = frame.camera(parameters)
    sigma = [
        orientation.focal_sigma_px / orientation.focal_px, orientation.tilt_sigma_rad,
        orientation.roll_sigma_rad,
        np.hypot(found.relative_sigma, population_sigma_m / person_height_m), 0.0,
    ]  # fmt: skip
    inlier = np.zeros(len(segments), bool)
    inlier[usable] = found.inlier
    residual = np.full(len(segments), np.nan)
    residual[usable] = _head_error(camera.P, foot, head, person_height_m)
    finite = np.where(np.isfinite(sigma), sigma, 0.0)
    calibration = result(
        "ok", camera=camera, covariance=np.diag(finite**2), inlier=inlier, residual=residual
    )
    ground, _ = _ground_error(calibration)
    return result(
        "ok", camera=camera, covariance=np.diag(finite**2), inlier=inlier, residual=residual,
        ground_error_m=ground,
    )  # fmt: skip


def _head_error(
    P: np.ndarray, foot: np.ndarray, head: np.ndarray, person_height_m: float
) -> np.ndarray:
    """Distance between seen and predicted head over the length of the person."""
    xy, _ = locate(P, foot)
    uv, _ = project(P, np.column_stack([xy, np.full(len(xy), person_height_m)]))
    return np.hypot(*(uv - head).T) / np.maximum(np.hypot(*(foot - head).T), 1e-9)
