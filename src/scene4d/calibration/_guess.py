"""What the orientation network's reading is worth in a calibration.

The network guesses and the people are measured. So where both are there, the camera is solved for
without the guess as well: a guess that this contradicts is left out, and the result says so.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from scene4d.calibration import _verdict as verdict
from scene4d.calibration._case import saying
from scene4d.calibration._prior import default_prior
from scene4d.calibration._solve import solve_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.orienting import OrientationReading, read_straightened
from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections, Segments

TILT_WIDENING = 1.5
"""Of the network's standard deviation of tilt where it is a guess: the root mean square of its
errors in it on nine real cameras (PETS 2009, TownCentre twice, two laboratory cameras, four of
MEVA). Those of focal length and roll are 0.6 and 0.8 there."""
_BENT = 0.01
"""Displacement of the picture's corner by its lens, in half diagonals, above which the network
reads the picture once more without it: a pixel of the 120 that it sees there."""


def solve_guided(
    segments: Segments,
    image_size: tuple[int, int],
    options: CalibrateOptions,
    reading: OrientationReading | None,
    *,
    edges_xyxy: Float[np.ndarray, "m 4"] | None = None,
    vehicles: Detections | None = None,
    alone: Calibration | None = None,
    image_bgr: UInt8[np.ndarray, "h w 3"] | None = None,
) -> Calibration:
    """As :func:`.solve_segments`, with the network's ``reading`` where ``options`` ask for it.

    ``alone`` is the joint method's answer without the network, where it is known already. Where
    people say that the lens bends the footage, the network reads the scene in ``image_bgr`` once
    more without that: it learned from pictures that hardly any lens bends. Boxes that belong to no
    track are not asked: counted each for itself, what a detector gets wrong over the picture passes
    for distortion (Faster R-CNN on PETS 2009: by six sigmas).
    """

    def solve(asked: CalibrateOptions, *, guessed: bool = False) -> Calibration:
        return solve_segments(
            segments, image_size, asked, edges_xyxy=edges_xyxy, vehicles=vehicles, guessed=guessed
        )

    if reading is None or not options.uses_network:
        return solve(options)
    people_only = replace(options, method="joint", orientation="people")
    alone = solve(people_only) if alone is None else alone
    if options.method == "paper" or options.orientation == "network":
        paper = options.method == "paper"
        believed = reading.most_frequent if paper else reading.orientation
        found = solve(replace(options, orientation=believed), guessed=True)
        text = contradicted(alone, believed)
        return saying(found, f"{text} The reading was kept.") if text else found

    def guided(stated: Orientation) -> Calibration:
        guess = as_guess(stated)
        return alone if guess is None else solve(replace(options, orientation=guess), guessed=True)

    if image_bgr is not None and reading.lens is None:
        tracked = bool((segments.track >= 0).all())
        bent = guided(reading.orientation) if tracked and not alone else alone
        reading = _read_straight(image_bgr, bent) or reading
    stated = reading.orientation
    text = contradicted(alone, stated)
    if text:
        return _without(alone, text)
    found = guided(stated)
    if alone or not found:
        return found or alone
    text = contradicted(found, stated)
    if text:  # not even together do they make a camera
        return saying(alone, f"{text} The reading was left out.")
    return saying(
        found,
        "The people alone do not determine this camera; it also uses the orientation "
        f"network's estimate, which is a guess: {_words(stated)}.",
    )


def _read_straight(image_bgr: np.ndarray, found: Calibration) -> OrientationReading | None:
    """What the network reads without the distortion of a camera that was found; None where there is
    hardly any, or no camera.
    """
    if found.camera is None:
        return None
    lens = found.camera.lens
    corner = np.zeros((1, 2))
    shift = np.hypot(*(lens.undistort(corner)[0] - corner)[0])
    if shift < _BENT * np.hypot(*lens.image_size) / 2:
        return None
    return read_straightened(image_bgr, lens)


def _without(alone: Calibration, text: str) -> Calibration:
    """The camera from people alone, against the network; a refusal if few people agree."""
    share = alone.inliers / max(alone.people, 1)
    if share >= verdict.FEW_INLIERS:
        return saying(alone, f"{text} The reading was left out.")
    return replace(
        alone,
        status="undetermined",
        camera=None,
        covariance=None,
        residual=None,
        ground_error_m=None,
        ground_error_from_camera_m=None,
        reason=f"only {share:.0%} of the sightings agree with one camera, and the orientation "
        "network's estimate contradicts it; needed: people who stand upright on the same plane, or "
        'a lens file (lens), or orientation="people" if the images are misleading',
        warnings=(*alone.warnings, text),
    )


def contradicted(alone: Calibration, stated: Orientation) -> str:
    """A sentence that names the contradicted values, or an empty text."""
    apart = [
        f"{name} {said} against {found}"
        for name, said, found in verdict.disagreements(alone, stated)
    ]
    if not apart:
        return ""
    return f"The orientation network's estimate contradicts the people: {'; '.join(apart)}."


def as_guess(stated: Orientation) -> Orientation | None:
    """The network's reading as a prior: its tilt widened, and silent (infinite) on what is then
    vaguer than what holds of any camera. None where that is everything.

    Focal length and roll are believed as they are stated: on held-out panoramas their errors are
    0.8 of the standard deviations. Widened by half, the reading of a focal length where the horizon
    is known would be worth 0.24 nats less there.
    """
    spread = np.array(stated.spread) * (1.0, TILT_WIDENING, 1.0)
    spread[spread >= default_prior().sigma[:3]] = np.inf
    if np.isinf(spread).all():
        return None
    focal, tilt, roll = spread.tolist()
    return replace(
        stated,
        focal_sigma_px=focal * stated.focal_px,
        tilt_sigma_rad=tilt,
        roll_sigma_rad=roll,
    )


def _words(told: Orientation) -> str:
    tilt, tilt_sigma, roll, roll_sigma = np.degrees(
        [told.tilt_rad, told.tilt_sigma_rad, told.roll_rad, told.roll_sigma_rad]
    )
    return (
        f"focal length {told.focal_px:.0f} ± {told.focal_sigma_px:.0f} px, "
        f"tilt {tilt:.1f} ± {tilt_sigma:.1f}°, roll {roll:.1f} ± {roll_sigma:.1f}°"
    )
