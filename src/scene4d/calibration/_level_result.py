"""What a second ground level adds to a calibration: its regions, and a sentence."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from scene4d.calibration._case import saying
from scene4d.calibration._level_region import ground_regions
from scene4d.calibration._levels import Level
from scene4d.core.calibration import Calibration


def with_level(
    found: Calibration, level: Level | None, usable: Bool[np.ndarray, "n"]
) -> Calibration:
    """The calibration with the regions of a level that is believed; a warning in either case."""
    if level is None or not found or found.camera is None:
        return found
    if not level.believed:
        shorter = 1 - found.camera.height_m / (found.camera.height_m - level.height_m)
        return saying(found, _undecided(level, shorter))
    assert found.segments is not None and found.inlier is not None
    segments = found.segments.select(usable)
    regions = ground_regions(
        level,
        segments.foot_uv,
        segments.head_uv,
        found.inlier[usable] & level.inside,
        found.image_size,
    )
    return saying(replace(found, ground_regions=regions), _believed(level))


def _believed(level: Level) -> str:
    where = "above" if level.height_m > 0 else "below"
    return (
        f"{level.people} people stand on a second ground level, {abs(level.height_m):.2f} ± "
        f"{level.sigma_m:.2f} m {where} the one that the camera refers to; positions there use its "
        "height; check its outline in the figure."
    )


def _undecided(level: Level, shorter: float) -> str:
    return (
        f"{level.people} people in one part of the picture are seen {shorter:.0%} shorter than "
        f"elsewhere, as if its ground were {-level.height_m:.1f} m lower, or as if they were "
        "children, seated, or hidden below the knee; if it is lower, positions there are that much "
        "too near; footage in which people walk from one part to the other would tell."
    )
