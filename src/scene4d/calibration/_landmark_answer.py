"""The calibration from landmarks and people: camera or refusal, and how the landmarks agree."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration import _verdict as verdict
from scene4d.calibration._body import FOCAL, HEIGHT, ROLL, TILT
from scene4d.calibration._case import Case
from scene4d.calibration._joint import solve
from scene4d.calibration._landmark_residuals import SHIFT
from scene4d.calibration._landmarks import LandmarkTerm
from scene4d.calibration._lens_choice import with_best_lens
from scene4d.calibration._prior import inverse_of
from scene4d.calibration._problem import Noise, Problem, State, spreads
from scene4d.calibration._refine import linearise
from scene4d.calibration._uncertainty import data_covariance, most_probable
from scene4d.calibration._with_landmarks import Belief, Fused, fused, landmark_starts
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.ground_errors import ground_errors
from scene4d.core.landmarks import LandmarkFit, Landmarks


def landmark_answer(
    case: Case,
    problem: Problem,
    known: Landmarks,
    covariance_of_people: Callable[[Case, Problem, State], np.ndarray],
) -> Calibration:
    """The calibration from landmarks and people, as many as there are, or its refusal.

    Raises :class:`InputError` for landmarks that fit as a mirror image alone.
    """
    prior, term = problem.prior, LandmarkTerm.of(known, case.frame)
    anybody = len(problem.track) > 0
    starts = landmark_starts(term, prior)
    state = State(prior.mean, np.zeros(problem.n_heights), Noise())
    if anybody:
        both = replace(problem, terms=(term,))
        state = solve(both, seed=case.asked.seed, more_starts=starts) or state
        starts = np.vstack([state.parameters, starts[0]])
        problem, state = with_best_lens(problem, state, seed=case.asked.seed)
        if problem.points.fisheye:
            case, term = replace(case, frame=replace(case.frame, fisheye=True)), term.with_fisheye()
            starts, prior = state.parameters[None], problem.prior

    alone, beyond = None, np.zeros_like(prior.precision)
    if anybody:
        # What people's errors have in common shows at their own answer.
        own = solve(problem, seed=case.asked.seed) or state
        covariance = covariance_of_people(case, problem, own)
        beyond = covariance - data_covariance(problem, own)
        if len(problem.track) >= verdict.MIN_PEOPLE:
            alone = Belief.of(own.parameters, covariance)

    def people(parameters: np.ndarray) -> Belief:
        if not anybody:
            return Belief(prior.mean, prior.precision)
        there = replace(state, parameters=parameters)
        covariance = data_covariance(problem, there) + beyond
        return Belief.of(most_probable(problem, there), covariance)

    found = fused(term, prior, starts[:2], people)
    state = replace(state, parameters=found.parameters)
    return _judged(case, problem, known, state, found, alone)


def _judged(
    case: Case, problem: Problem, known: Landmarks, state: State, found: Fused, alone: Belief | None
) -> Calibration:
    lin, few = linearise(problem, state), len(problem.track) == 0
    inlier = case.over_all(lin.inlier > 0.5, False)
    camera = case.frame.camera(found.parameters)
    fit = landmark_fit(found, known, camera)
    along, across = spreads(problem, state.noise)
    answer = case.found(
        camera=camera,
        covariance=found.covariance,
        inlier=inlier,
        residual=case.over_all(np.hypot(lin.residual[0] * along, lin.residual[1] * across), np.nan),
        landmarks=fit,
    )
    errors = ground_errors(answer)
    why = verdict.landmark_refusal(found.covariance, errors.relative)
    boxes = not few and bool(problem.points.from_box.all())
    if why is None and boxes and found.focal_sigma_without_people() > verdict.FOCAL_KNOWN:
        why = verdict.BOXES_ALONE
    if why is not None:
        return case.undetermined(why, inlier)
    said = list(landmark_warnings(found, fit))
    if alone is not None:
        said += _contradictions(found, alone, camera, case.asked.person_height_m)
    return replace(
        answer,
        ground_error_m=errors.within,
        ground_error_from_camera_m=errors.from_camera,
        warnings=(
            *said,
            *([verdict.FISHEYE_FOUND] if case.frame.fisheye else []),
        ),
    )


def landmark_fit(found: Fused, known: Landmarks, camera: Camera) -> LandmarkFit:
    """What each landmark is off by, and where the camera stands in their frame."""
    term, parameters = found.term, found.parameters
    frame = term.frame_at(parameters)
    points, uprights, distances = term.of_kinds(parameters, frame)
    on_ground = np.linalg.solve(points.by[:, :, SHIFT], points.value[:, :, None])
    span = np.hypot(*(term.tops.at - term.feet.at))
    off_m = [
        np.hypot(*on_ground[:, :, 0].T),
        term.height_m * np.hypot(*uprights.value.T) / span,
        np.abs(np.expm1(distances.value[:, 0])) * term.distance_m,
    ]
    off2 = np.concatenate([kind.off2 for kind in (points, uprights, distances)])
    stands, heading = None, None
    if known.points:
        middle = np.mean([point.xy_m for point in known.points], axis=0)
        x_m, y_m = middle - frame[1:]
        stands, heading = (float(x_m), float(y_m)), float(np.pi / 2 - frame[0])
    return LandmarkFit(
        known,
        np.sqrt(off2) * found.stretch,
        np.concatenate(off_m),
        term.right(parameters) > 0.5,
        _expected_uv(known, term.xyz_m, frame, camera),
        stands,
        heading,
    )


def _expected_uv(
    known: Landmarks, xyz_m: np.ndarray, frame: np.ndarray, camera: Camera
) -> Float[np.ndarray, "n 2"]:
    stand = np.exp(1j * frame[0]) * (xyz_m[0] + frame[1] + 1j * (xyz_m[1] + frame[2]))
    points, _ = camera.project(np.column_stack([stand.real, stand.imag, xyz_m[2]]))
    feet = np.array([upright.foot_uv for upright in known.uprights], float).reshape(-1, 2)
    height_m = np.array([upright.height_m for upright in known.uprights])
    tops, _ = camera.project(np.column_stack([camera.locate(feet)[0], height_m]))
    return np.vstack([points, tops, np.full((len(known.distances), 2), np.nan)])


def landmark_warnings(found: Fused, fit: LandmarkFit) -> Iterator[str]:
    """Sentences about landmarks that are not as stated."""
    names = fit.landmarks.names()
    for row in np.flatnonzero(~fit.used):
        yield (
            f"The landmark {names[row]} is {fit.off_m[row]:.2f} m from where the others put it and "
            "was left out; check its pixel and its measurement."
        )
    if found.stretch > 1:
        worst = int(np.argmax(np.where(fit.used, fit.off_sigmas, 0.0)))
        yield (
            f"The landmarks miss one another by {found.stretch:.1f} times what they state, and "
            f"count that much less; the largest miss is that of {names[worst]} "
            f"({fit.off_m[worst]:.2f} m)."
        )


def _contradictions(
    found: Fused, people: Belief, camera: Camera, person_height_m: float
) -> Iterator[str]:
    """Sentences about values that differ from those of the people alone."""
    alone = inverse_of(people.precision, np.diag(people.precision) > 0)
    sigma, together = np.sqrt(np.diag(alone)), np.sqrt(np.diag(found.covariance))
    moved = found.parameters - people.mean
    for name, index in (
        ("focal length", FOCAL),
        ("tilt", TILT),
        ("roll", ROLL),
        ("height", HEIGHT),
    ):
        if abs(moved[index]) <= verdict.SIGMAS * np.hypot(sigma[index], together[index]):
            continue
        with_them, by_people = (
            _words(index, shift, spread, camera)
            for shift, spread in ((0.0, together[index]), (moved[index], sigma[index]))
        )
        so = ""
        if index == HEIGHT:
            mean_m = person_height_m * float(np.exp(moved[index]))
            so = f" (people would be {mean_m:.2f} m tall on average)"
        yield (
            f"The landmarks contradict the people: {name} {with_them} with the landmarks{so}, "
            f"{by_people} by the people alone. The landmarks were followed; check them if the "
            "people are not unusual."
        )


def _words(index: int, moved: float, sigma: float, camera: Camera) -> str:
    """A value ``moved`` back from the camera's, with its standard deviation."""
    if index in (TILT, ROLL):
        angle = camera.tilt_rad if index == TILT else camera.roll_rad
        return "{:.1f} ± {:.1f}°".format(*np.degrees([angle - moved, sigma]))
    size, unit, digits = (camera.focal_px, "px", 0) if index == FOCAL else (camera.height_m, "m", 2)
    value = size * float(np.exp(-moved))
    return f"{value:.{digits}f} ± {value * sigma:.{digits}f} {unit}"
