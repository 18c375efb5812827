"""From what was seen to a calibration, and what the orientation network's reading is worth in it.

The network guesses and the people are measured. So where both are there, the camera is solved for
without the guess as well: a guess that this contradicts is left out, and said to be.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from scene4d.calibration.options import Options, Seen
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments

POPULATION_SIGMA_M = 0.03
"""How well the mean height of the people in front of a camera is known beforehand."""
NETWORK_WIDENING = 1.5
"""Of the network's standard deviations where it is a guess: they are honest on pictures like those
that it was trained on, and a user's camera is another one (docs/orientation.md lists six real ones:
their errors are 1.1 of them for tilt, less for the rest)."""
NO_PICTURES = (
    "There are no pictures to show to the orientation network, so the camera rests on the people "
    "alone."
)


def solved(
    seen: Seen, lens: Lens | None, options: Options, orientation: Orientation | None
) -> Calibration:
    """The calibration of what was seen, with what was noticed on the way among its warnings.

    ``orientation`` is what was told; without it the network's reading counts, where there is one
    and the options ask for it.
    """
    from scene4d.calibration import missing_keypoints, person_segments

    found = camera_of(person_segments(seen.detections), seen, lens, options, orientation)
    said = [*seen.notes]
    missing = missing_keypoints(seen.detections)
    if missing:
        said.append(
            f"The annotations' keypoints lack {', '.join(missing)}; their boxes were used instead."
        )
    return replace(found, frames=seen.frames, warnings=(*said, *found.warnings))


def camera_of(
    segments: Segments,
    seen: Seen,
    lens: Lens | None,
    options: Options,
    orientation: Orientation | None,
    *,
    alone: Calibration | None = None,
) -> Calibration:
    """As :func:`solved`, of these people of what was seen; ``alone`` is the joint method's answer
    without the network, where it is known already.
    """
    from scene4d.calibration import solve_segments

    solve = partial(
        solve_segments,
        segments,
        image_size=seen.detections.image_size,
        person_height_m=options.person_height_m,
        lens=lens,
        estimate_focal=options.estimate_focal,
        lines_xyxy=seen.edges,
        population_sigma_m=POPULATION_SIGMA_M,
        systematics=True,
        seed=options.seed,
    )
    reading = seen.reading
    if orientation is not None or reading is None or not options.uses_network:
        return solve(orientation=orientation, method=options.method)
    alone = solve() if alone is None else alone
    if options.method == "joint" and options.orientation == "auto":
        return _guided(solve, alone, reading.orientation)
    paper = options.method == "paper"
    believed = reading.most_frequent if paper else reading.orientation
    found = solve(orientation=believed, method=options.method, guessed=True)
    return _warned(found, alone, believed)


def _guided(
    solve: Callable[..., Calibration], alone: Calibration, stated: Orientation
) -> Calibration:
    """With the network's reading as a wide prior, unless what is measured contradicts it."""
    from scene4d.calibration import disagreements

    apart = disagreements(alone, stated)
    if apart:
        return _saying(alone, f"{_contradicted(apart)} The reading was left out.")
    guess = as_guess(stated)
    if guess is None:
        return alone
    found = solve(orientation=guess, guessed=True)
    if alone or not found:
        return found or alone
    apart = disagreements(found, stated)
    if apart:  # not even together do they make a camera
        return _saying(alone, f"{_contradicted(apart)} The reading was left out.")
    return _saying(
        found,
        "The people alone do not determine this camera; it also rests on the orientation "
        f"network's reading, which is a guess: {_words(stated)}.",
    )


def _warned(found: Calibration, alone: Calibration, believed: Orientation) -> Calibration:
    """With a word where the people contradict what was asked to be believed."""
    from scene4d.calibration import disagreements

    apart = disagreements(alone, believed)
    return _saying(found, f"{_contradicted(apart)} The reading was kept.") if apart else found


def as_guess(stated: Orientation) -> Orientation | None:
    """The network's reading as a prior: widened, and silent (infinite) on what is then vaguer than
    what holds of any camera. None where that is everything.
    """
    from scene4d.calibration import default_prior

    spread = NETWORK_WIDENING * np.array(
        [stated.focal_sigma_px / stated.focal_px, stated.tilt_sigma_rad, stated.roll_sigma_rad]
    )
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


def _saying(found: Calibration, text: str) -> Calibration:
    return replace(found, warnings=(*found.warnings, text))


def _contradicted(apart: list[str]) -> str:
    return (
        "The orientation network's reading of the pictures contradicts what the people show: "
        f"{'; '.join(apart)}."
    )


def _words(told: Orientation) -> str:
    tilt, tilt_sigma, roll, roll_sigma = np.degrees(
        [told.tilt_rad, told.tilt_sigma_rad, told.roll_rad, told.roll_sigma_rad]
    )
    return (
        f"focal length {told.focal_px:.0f} ± {told.focal_sigma_px:.0f} px, "
        f"tilt {tilt:.1f} ± {tilt_sigma:.1f}°, roll {roll:.1f} ± {roll_sigma:.1f}°"
    )


def told_orientation(options: Options) -> Orientation | None:
    """The orientation that was given, or None where a word says who finds it."""
    chosen = options.orientation
    if isinstance(chosen, Orientation):
        return chosen
    return None if chosen in ("auto", "people", "network") else Orientation.load(chosen)


def check_pictures(options: Options) -> None:
    """Refuse where there are no pictures and nothing can be done without; raises
    :class:`InputError`.
    """
    if options.needs_network:
        why = "the paper's method" if options.method == "paper" else "--orientation network"
        raise InputError(
            f"{why} needs pictures for the orientation network to look at, and there are "
            "annotations alone: give a SOURCE as well, or --orientation FILE"
        )


def without_pictures(seen: Seen, options: Options) -> None:
    """Note that the network could not be asked, where it would have been."""
    if options.uses_network:
        seen.notes.append(NO_PICTURES)


def told_lens(options: Options, image_size: tuple[int, int]) -> Lens | None:
    """The lens file that was given, for images of this size, or None."""
    if options.lens is None:
        return None
    from scene4d.formats.cameras import read_lens

    return read_lens(options.lens, image_size=image_size)
