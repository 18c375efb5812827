"""From what was seen to a calibration."""

from dataclasses import replace

from scene4d.errors import UnavailableError
from scene4d.model import Calibration, Lens, Orientation
from scene4d.pipeline.options import Options, Seen

POPULATION_SIGMA_M = 0.03
"""How well the mean height of the people in front of a camera is known beforehand."""


def solved(
    seen: Seen, lens: Lens | None, options: Options, orientation: Orientation | None
) -> Calibration:
    """The calibration of what was seen, with what was noticed on the way among its warnings."""
    from scene4d.calibration import missing_keypoints, person_segments, solve_segments

    found = solve_segments(
        person_segments(seen.detections),
        image_size=seen.detections.image_size,
        person_height_m=options.person_height_m,
        orientation=orientation,
        method=options.method,
        lens=lens,
        estimate_focal=options.estimate_focal,
        lines_xyxy=seen.edges,
        population_sigma_m=POPULATION_SIGMA_M,
        systematics=True,
        seed=options.seed,
    )
    said = [*seen.notes]
    missing = missing_keypoints(seen.detections)
    if missing:
        said.append(
            f"The annotations' keypoints lack {', '.join(missing)}; their boxes were used instead."
        )
    return replace(found, frames=seen.frames, warnings=(*said, *found.warnings))


def told_orientation(options: Options) -> Orientation | None:
    """The orientation that was given, or None; raises where the network is asked for."""
    chosen = options.orientation
    if isinstance(chosen, Orientation):
        return chosen
    if chosen == "network":
        raise UnavailableError(
            "the orientation network is not part of this version: use --orientation auto, or a "
            "JSON file with focal_px, tilt_deg and roll_deg"
        )
    return None if chosen in ("auto", "people") else Orientation.load(chosen)


def told_lens(options: Options, image_size: tuple[int, int]) -> Lens | None:
    """The lens file that was given, for images of this size, or None."""
    if options.lens is None:
        return None
    from scene4d.formats.cameras import read_lens

    return read_lens(options.lens, image_size=image_size)
