"""``solve_camera``: from the feet and heads of people to the camera that sees them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration import _verdict as verdict
from scene4d.calibration._body import FOCAL, HEIGHT, Points
from scene4d.calibration._case import Case, ImageFrame, different_people, saying
from scene4d.calibration._doubts import Doubts, doubts
from scene4d.calibration._drift import Drift
from scene4d.calibration._joint import TRACK_CORRELATION, places_of, position_weights, solve
from scene4d.calibration._landmark_answer import landmark_answer
from scene4d.calibration._lens_choice import with_best_lens
from scene4d.calibration._level_result import with_level
from scene4d.calibration._levels import second_level
from scene4d.calibration._lines import Lines
from scene4d.calibration._paper import paper_calibration
from scene4d.calibration._prior import CENTRE_SIGMA, Prior, default_prior
from scene4d.calibration._problem import Problem, State, spreads
from scene4d.calibration._refine import linearise
from scene4d.calibration._traffic import Traffic, joined
from scene4d.calibration._uncertainty import covariance
from scene4d.calibration.options import POINTS, CalibrateOptions
from scene4d.core.body import FOOT_HEIGHT_M, HEIGHT_SIGMA_M, PERSON_HEIGHT_M
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.ground_errors import ground_errors
from scene4d.core.landmarks import Landmarks
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections, Segments
from scene4d.core.points import ImageSize, as_image_size

_SMALL = 0.02
"""Length in half diagonals at which pixels matter as much as everything else: 20 px in a picture of
1600x1200, where an error of half a pixel at both ends is the 3 % that :class:`.Noise` starts from.
"""
STILL_WEIGHT = 0.1
"""Of a box whose track never leaves its place where others walk: it may sit, or be cut by what it
stands behind, which a box does not show, or be no person. Chosen: ten of them count as one walker.
With the true lens it brings tilt from boxes nearer to the truth on seven of ten cameras and
farther on none by more than 0.2°."""
_LENS_AGREEMENT = 0.03
"""Relative difference of two given focal lengths that is worth a warning. Chosen by hand: three
times what lens calibrations of one camera differ by."""


def solve_camera(
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    *,
    image_size: ImageSize,
    person_height_m: float = PERSON_HEIGHT_M,
    foot_height_m: float = FOOT_HEIGHT_M,
    track: Int[np.ndarray, "n"] | None = None,
    prior: Orientation | None = None,
    method: str = "joint",
    landmarks: str | Path | Landmarks | None = None,
) -> Calibration:
    """The camera that sees upright people with these feet and heads (undistorted pixels).

    ``method="joint"`` estimates focal length, tilt, roll and height together; ``prior`` may state
    what is known of the first three. ``method="paper"`` takes them from ``prior`` and solves for
    the height alone (Wagner et al. 2019). ``person_height_m`` is the mean height of the
    population, and all uncertainties are conditional on it; ``foot_height_m`` is the height of
    the foot points above the ground. ``track`` says which rows are one person, in order of time;
    -1 is unknown. Rows of unknown track may all be one person, and the uncertainty of the scale
    allows for it: pass ``track=np.arange(n)`` if every row is another person. ``landmarks`` (or
    their file) are what was measured in the scene, in undistorted pixels too.

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
    options = replace(
        POINTS,
        person_height_m=person_height_m,
        foot_height_m=foot_height_m,
        orientation="people" if prior is None else prior,
        method=method,
        landmarks=landmarks,
    ).read(as_image_size(image_size))
    # Rows of points do not say which were seen at one moment: each has a frame of its own.
    segments = replace(segments, frame=np.arange(len(foot)))
    return solve_segments(segments, image_size, options)


def solve_segments(
    segments: Segments,
    image_size: ImageSize,
    options: CalibrateOptions,
    *,
    edges_xyxy: Float[np.ndarray, "m 4"] | None = None,
    vehicles: Detections | None = None,
    guessed: bool = False,
) -> Calibration:
    """As :func:`solve_camera`, on segments in pixels of the footage.

    The files that ``options`` name must have been read (:meth:`CalibrateOptions.read`).
    ``edges_xyxy`` are straight edges of the scene in the same pixels, ``vehicles`` tracked boxes,
    sorted by time, which the paper's method leaves aside. A ``guessed`` orientation is not named
    where the people contradict it: the caller asks :func:`.disagreements`.
    """
    if options.method == "paper" and options.known_orientation is None:
        raise InputError("the paper's method needs an orientation: pass one, or read the network's")
    image_size = as_image_size(image_size)
    case = Case(segments, ImageFrame(image_size, options.known_lens), options)
    usable = case.usable
    known = options.known_landmarks
    traffic = None if options.method == "paper" else Traffic.of(vehicles, case.frame)
    enough = traffic is not None and len(traffic) >= verdict.MIN_VEHICLES
    if usable.sum() < verdict.MIN_PEOPLE and not enough and known is None:
        moving = None if vehicles is None else 0 if traffic is None else len(traffic)
        return case.undetermined(verdict.too_few(int(usable.sum()), moving))
    if options.method == "paper":
        return paper_calibration(case)
    prior = _prior(case, of_middle=guessed)
    if known is not None:
        problem = _problem(case, prior, edges_xyxy, None)
        found = landmark_answer(case, problem, known, _covariance_of_people)
        return _with_contradictions(case, found, guessed)
    boxes = bool(segments.from_box[usable].all()) and not enough
    if boxes and prior.sigma[FOCAL] > verdict.FOCAL_KNOWN:
        return case.undetermined(verdict.BOXES_ALONE)
    problem = _problem(case, prior, edges_xyxy, traffic)
    starts = None if traffic is None else traffic.starts(prior)
    state = solve(problem, seed=options.seed, more_starts=starts)
    if state is None:
        if verdict.hanging(problem.points):
            return case.undetermined(verdict.HANGING)
        return case.undetermined("no camera above the ground explains what is seen")
    if traffic is None:  # the vehicles' model has no fisheye lens
        problem, state = with_best_lens(problem, state, seed=options.seed)
    if problem.points.fisheye:
        case = replace(case, frame=replace(case.frame, fisheye=True))
    level = None
    if traffic is None and _tells_levels(segments.select(usable)):
        feet_uv = segments.foot_uv[usable]
        level = second_level(problem, state, feet_uv, systematics=options.systematics)
    if level is not None and level.believed:
        problem, state = level.problem, level.state
    found = with_level(_judged(case, problem, state, traffic), level, usable)
    if found and problem.points.fisheye:
        found = saying(found, verdict.FISHEYE_FOUND)
    return _with_contradictions(case, found, guessed, vehicles)


def _tells_levels(segments: Segments) -> bool:
    """Whether a second ground level may be asked for. The drift of boxes over the picture passes
    for one (Faster R-CNN on PETS 2009: 0.55 m), and so do sightings of nobody in particular.
    """
    return bool(not segments.from_box.any() and (segments.track >= 0).all())


def _with_contradictions(
    case: Case, found: Calibration, guessed: bool, vehicles: Detections | None = None
) -> Calibration:
    if not found or guessed:
        return found
    return saying(found, *_contradictions(case, vehicles))


def _prior(case: Case, *, of_middle: bool) -> Prior:
    """What is known before anybody is seen; ``of_middle`` if a known orientation is that of the
    picture's middle.
    """
    asked, unit = case.asked, case.frame.half_diagonal_px
    measured = case.frame.lens is not None
    prior = default_prior(
        estimate_distortion=asked.estimate_distortion and not measured,
        centre_sigma=CENTRE_SIGMA if asked.systematics and not measured else 0.0,
    )
    if asked.known_orientation is not None:
        prior = prior.with_orientation(asked.known_orientation, unit)
        prior = replace(prior, of_middle=of_middle and not measured)
    if asked.fixed_focal_px is not None:
        prior = prior.with_focal(asked.fixed_focal_px, unit)
    return prior


def _problem(
    case: Case, prior: Prior, edges_xyxy: np.ndarray | None, traffic: Traffic | None
) -> Problem:
    """The minimisation over the usable people and the vehicles."""
    points = case.points.select(case.usable)
    track = _renumbered(case.segments.track[case.usable])
    length = np.hypot(*(points.head - points.foot))
    correlation = TRACK_CORRELATION if case.asked.systematics else 0.0
    weight = position_weights(points.foot, length, track, correlation)
    if case.asked.systematics and points.has_boxes:
        places = _places_seen(points, track)
        still = (places <= 1) & (case.segments.track[case.usable] >= 0) & (places > 1).any()
        weight = np.where(still & points.from_box, STILL_WEIGHT * weight, weight)
    lines = None
    if edges_xyxy is not None and len(edges_xyxy):
        lines = _lines(case.frame, edges_xyxy)
    drift = Drift.of(points, track) if case.asked.systematics and case.usable.any() else None
    terms = () if traffic is None else (traffic.vehicles,)
    return Problem(
        points, track, weight, case.asked.person_height_m, prior, lines, terms, drift=drift,
        blur=_blur(case, length),
    )  # fmt: skip


def _blur(case: Case, length: np.ndarray) -> np.ndarray:
    """How many times the noise of somebody seen large and from the side each of the usable people
    has (n,), of their ``length`` in half diagonals.

    Keypoints err by a share of the picture that the network is shown, that of the whole body. From
    above a body is shorter than its box is wide, so that its direction is known less well.
    """
    boxes = case.segments.box_xyxy[case.usable]
    box = (boxes[:, 2:] - boxes[:, :2]).max(axis=1) / case.frame.half_diagonal_px
    blur: np.ndarray = np.hypot(np.fmax(box, length), _SMALL) / length
    return blur


def _places_seen(points: Points, track: np.ndarray) -> np.ndarray:
    """In how many places each row's person is seen (n,); 0 for who is seen once only."""
    places = places_of(points.foot, np.sqrt(points.seen2), track)
    seen: np.ndarray = np.where(np.bincount(track) > 1, places, 0)[track]
    return seen


def _renumbered(track: np.ndarray) -> np.ndarray:
    """Tracks as 0..t-1, with a track of its own for every person without one."""
    unknown = track < 0
    own = np.where(unknown, track.max(initial=0) + 1 + np.arange(len(track)), track)
    return np.unique(own, return_inverse=True)[1]


def _lines(frame: ImageFrame, xyxy: np.ndarray) -> Lines:
    both = frame.straight(xyxy.reshape(-1, 2)).T.reshape(-1, 4)
    both = both[np.isfinite(both).all(axis=1)]
    both = both[np.hypot(both[:, 2] - both[:, 0], both[:, 3] - both[:, 1]) > 1e-6]
    unit = frame.half_diagonal_px
    return Lines.from_pixels(both * unit, np.zeros(2), unit)


def _judged(case: Case, problem: Problem, state: State, traffic: Traffic | None) -> Calibration:
    """The calibration of a solved problem, or its refusal."""
    people = different_people(case.segments.select(case.usable))
    vehicles = 0 if traffic is None else len(traffic)
    cov = _covariance_of_people(case, problem, state, vehicles)
    lin = linearise(problem, state)
    agreeing = lin.inlier > 0.5
    inlier = case.over_all(agreeing, False)
    camera = case.frame.camera(state.parameters)
    rulers, used = problem.points, None
    if traffic is not None:
        fits = traffic.vehicles.agreeing(state.parameters)
        rulers, used = joined(rulers, traffic.uprights), traffic.detections.select(fits)
        agreeing = np.concatenate([agreeing, fits])
    errors = ground_errors(case.found(camera=camera, covariance=cov, inlier=inlier, vehicles=used))
    share = float(agreeing.mean())
    depth = verdict.depth_of(rulers, camera.R[:, 2], agreeing)
    why = verdict.refusal(
        rulers, problem.prior, state.parameters, depth, cov, errors.relative, share,
        who=verdict.in_words(people, vehicles),
    )  # fmt: skip
    points = problem.points
    if why is None and traffic is None and case.asked.systematics and points.from_box.all():
        why = verdict.standing(_places_seen(points, problem.track))
    doubt = Doubts(why)
    if why is None and traffic is None:
        doubt = doubts(case, problem, state, people, share)
    if doubt.refusal is not None:
        return case.undetermined(doubt.refusal, inlier)
    along, across = spreads(problem, state.noise)
    said = verdict.warnings(len(agreeing), people, share, problem.prior, cov, n_vehicles=vehicles)
    return case.found(
        camera=camera,
        covariance=cov,
        inlier=inlier,
        residual=case.over_all(np.hypot(lin.residual[0] * along, lin.residual[1] * across), np.nan),
        ground_error_m=errors.within,
        ground_error_from_camera_m=errors.from_camera,
        vehicles=used,
        warnings=(*said, *doubt.warnings),
    )


def _covariance_of_people(
    case: Case, problem: Problem, state: State, vehicles: int = 0
) -> np.ndarray:
    people = different_people(case.segments.select(case.usable))
    found = covariance(problem, state)
    found[HEIGHT, HEIGHT] += _scale_variance(case, problem, people, vehicles)
    return found


def _scale_variance(case: Case, problem: Problem, people: int, vehicles: int) -> float:
    """Relative variance of the scale beyond the solver's: the population's mean is not known for
    sure, and sightings of unknown track may be fewer ``people`` than the solver counts. A vehicle
    tells the scale about as well as a person, and its own class' mean is in the solver's.
    """
    if people == 0:
        return 0.0
    counted = len(np.unique(problem.track))
    population2 = case.asked.population_sigma_m**2
    missing2 = HEIGHT_SIGMA_M**2 * max(1 / people - 1 / counted, 0.0)
    of_people = people / (people + vehicles)
    return of_people**2 * (population2 + missing2) / problem.person_height_m**2


def _contradictions(case: Case, vehicles: Detections | None) -> list[str]:
    """Sentences about given values that the people, asked again without them, contradict; none
    where nothing was given, and of boxes alone, which cannot answer.
    """
    asked = case.asked
    given, fixed = asked.known_orientation, asked.fixed_focal_px
    said = []
    if given is not None and fixed is not None:
        apart = abs(np.log(given.focal_px / fixed))
        if np.isfinite(given.focal_sigma_px) and apart > _LENS_AGREEMENT:
            said.append(
                f"The orientation's focal length ({given.focal_px:.0f} px) differs from the "
                f"lens file's ({fixed:.0f} px), which was used."
            )
    if fixed is not None:
        given = given or Orientation(fixed, 0.0, 0.0, 0.0, np.inf, np.inf)
        given = replace(given, focal_px=fixed, focal_sigma_px=0.0)
    who = "people" if asked.known_landmarks is None else "people and landmarks"
    of_boxes = asked.known_landmarks is None and case.segments.from_box[case.usable].all()
    if given is None or of_boxes:
        return said
    free = replace(asked, orientation="people", estimate_focal=True)
    alone = solve_segments(
        case.segments, case.frame.image_size, free, vehicles=vehicles, guessed=True
    )
    return said + [
        f"The {name} that was given, {stated}, contradicts the {who}, which alone give {found}."
        for name, stated, found in verdict.disagreements(alone, given)
    ]
