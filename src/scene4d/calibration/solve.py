"""``solve_camera``: from the feet and heads of people to the camera that sees them."""

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration import verdict
from scene4d.calibration.body import FOCAL, HEIGHT, Points
from scene4d.calibration.case import Assumptions, Case, check_asked, ground_error
from scene4d.calibration.contradiction import contradictions
from scene4d.calibration.frame import ImageFrame
from scene4d.calibration.joint import position_weights, solve
from scene4d.calibration.lines import Lines
from scene4d.calibration.paper import CONSENSUS, paper_calibration
from scene4d.calibration.prior import Prior, default_prior
from scene4d.calibration.refine import Problem, State, linearise, spreads
from scene4d.calibration.uncertainty import covariance
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import PERSON_HEIGHT_M, Segments

TRACK_CORRELATION = 0.12
"""Of one person's errors across the body in different places (gait, posture); PETS has 0.11
(benchmarks/keypoint_bias.py)."""


def solve_camera(
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    *,
    image_size: tuple[int, int],
    person_height_m: float = PERSON_HEIGHT_M,
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
    of the foot points above the ground. ``track`` says which rows are one person (-1: unknown);
    the rows of a person are in order of time.

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
    if track is not None and np.asarray(track).dtype.kind not in "iu":
        raise InputError("track must hold whole numbers, -1 where unknown")
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
    person_height_m: float = PERSON_HEIGHT_M,
    foot_height_m: float = 0.04,
    orientation: Orientation | None = None,
    guessed: bool = False,
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
    A ``guessed`` orientation is not named where the people contradict it: who guessed it asks
    :func:`.disagreements`. ``consensus`` (``"exact"`` or ``"ransac"``) is that of the paper's
    method, ``seed`` that of all sampling. Raises :class:`InputError` for values that make no sense.
    """
    check_asked(method, person_height_m, has_orientation=orientation is not None)
    if not 0 <= population_sigma_m < person_height_m:
        raise InputError(f"population_sigma_m must be 0 or more, found {population_sigma_m}")
    if consensus not in CONSENSUS:
        raise InputError(f"consensus must be one of {CONSENSUS}, found {consensus!r}")
    if min(image_size) < 1:
        raise InputError(f"image_size must be positive, found {image_size}")
    if not 0 <= foot_height_m < person_height_m / 2:
        raise InputError(f"foot_height_m must lie in 0 to half a person, found {foot_height_m}")
    asked = Assumptions(
        person_height_m=person_height_m,
        foot_height_m=foot_height_m,
        orientation=orientation,
        method=method,
        lens=lens,
        estimate_focal=estimate_focal,
        estimate_distortion=estimate_distortion,
        lines_xyxy=lines_xyxy,
        population_sigma_m=population_sigma_m,
        systematics=systematics,
        consensus=consensus,
        seed=seed,
    )
    frame = ImageFrame(image_size, lens)
    points = frame.points(segments, foot_height_m)
    usable = np.isfinite(points.foot).all(axis=0) & np.isfinite(points.head).all(axis=0)
    usable &= np.hypot(*(points.head - points.foot)) > 1e-6
    case = Case(segments, usable, frame, asked)
    if usable.sum() < verdict.MIN_PEOPLE:
        return case.undetermined(
            f"{int(usable.sum())} upright people are seen whole, and at least "
            f"{verdict.MIN_PEOPLE} are needed: use more footage, or footage with people in it"
        )
    if method == "paper":
        return paper_calibration(case)
    prior = _prior(case)
    if segments.from_box[usable].all() and prior.sigma[FOCAL] > verdict.FOCAL_KNOWN:
        return case.undetermined(verdict.BOXES_ALONE)
    problem = _problem(case, points.select(usable), prior)
    state = solve(problem, seed=seed)
    if state is None:
        return case.undetermined("no camera above the people explains what is seen")
    return _judged(case, problem, state, guessed=guessed)


def _prior(case: Case) -> Prior:
    """What is known before anybody is seen."""
    asked, unit = case.asked, case.frame.half_diagonal_px
    prior = default_prior(estimate_distortion=asked.estimate_distortion and case.frame.lens is None)
    if asked.orientation is not None:
        prior = prior.with_orientation(asked.orientation, unit)
    if asked.fixed_focal_px is not None:
        prior = prior.with_focal(asked.fixed_focal_px, unit)
    return prior


def _problem(case: Case, points: Points, prior: Prior) -> Problem:
    """The minimisation over the usable people."""
    asked = case.asked
    track = _renumbered(case.segments.track[case.usable])
    length = np.hypot(*(points.head - points.foot))
    correlation = TRACK_CORRELATION if asked.systematics else 0.0
    weight = position_weights(points.foot, length, track, correlation)
    lines = None
    if asked.lines_xyxy is not None and len(asked.lines_xyxy):
        lines = _lines(case.frame, asked.lines_xyxy)
    return Problem(points, track, weight, asked.person_height_m, prior, lines)


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
    both = both[np.hypot(both[:, 2] - both[:, 0], both[:, 3] - both[:, 1]) > 1e-6]
    unit = frame.half_diagonal_px
    return Lines.from_pixels(both * unit, np.zeros(2), unit)


def _judged(case: Case, problem: Problem, state: State, *, guessed: bool) -> Calibration:
    """The calibration of a solved problem, or its refusal."""
    measured = case.frame.lens is not None
    cov = covariance(problem, state, systematics=case.asked.systematics, measured_lens=measured)
    cov[HEIGHT, HEIGHT] += (case.asked.population_sigma_m / problem.person_height_m) ** 2
    lin = linearise(problem, state)
    inlier = case.over_all(lin.inlier > 0.5, False)
    camera = case.frame.camera(state.parameters)
    ground, relative = ground_error(case.found(camera=camera, covariance=cov, inlier=inlier))
    share = float(inlier[case.usable].mean())
    depth = verdict.depth_of(problem.points, camera.R[:, 2], lin.inlier > 0.5)
    why = verdict.refusal(problem.points, problem.prior, depth, cov, relative, share)
    if why is not None:
        return case.undetermined(why, inlier)
    along, across = spreads(problem, state.noise)
    people = len(np.unique(problem.track))
    said = verdict.warnings(int(case.usable.sum()), people, share, problem.prior, cov)
    if not guessed:
        said += contradictions(case, problem)
    return case.found(
        camera=camera,
        covariance=cov,
        inlier=inlier,
        residual=case.over_all(np.hypot(lin.residual[0] * along, lin.residual[1] * across), np.nan),
        ground_error_m=ground,
        warnings=tuple(said),
    )
