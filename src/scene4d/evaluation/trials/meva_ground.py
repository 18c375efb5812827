"""Where the ground is in front of a MEVA camera: the published files do not say.

Their frame is that of a whole site, whose terrain rises and falls by a metre and more, and slopes.
So the people say it, as they do for any camera: the published focal length and lens are kept, the
published tilt and roll are believed to a degree, and the height above the plane on which people
stand is free. Nothing of it is chosen by hand, and no label is looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections

_SLOPE_SIGMA_RAD = np.radians(1.0)
"""How far the local ground may slope against the horizontal."""
EVERY = 30
"""Frames between two sightings of a person that are used."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A camera over its local ground; ``reason`` says why it is the published one, if it is."""

    camera: str
    published: Calibration
    calibration: Calibration
    reason: str = ""

    def said(self) -> str:
        """Name, tilt and height, beside what was published."""
        was = self.published.camera
        assert was is not None
        before = f"tilt {np.degrees(was.tilt_rad):.1f}°, height {was.height_m:.1f} m"
        if self.reason:
            return f"{self.camera}: as published, {before} ({self.reason})"
        found = self.calibration
        assert found.camera is not None
        spread = np.sqrt(np.diag(found.parameter_covariance))
        return (
            f"{self.camera}: tilt {np.degrees(found.camera.tilt_rad):.1f} ± "
            f"{np.degrees(spread[1]):.1f}°, height {found.camera.height_m:.1f} ± "
            f"{found.camera.height_m * spread[3]:.1f} m (published: {before})"
        )


def local_ground(name: str, published: Calibration, annotated: Sequence[Detections]) -> Ground:
    """The published camera over the plane on which the people of its clips (one or more) stand."""
    from scene4d.calibration import CalibrateOptions, person_segments, solve_segments

    camera = published.camera
    assert camera is not None
    segments = person_segments(_thinned(annotated))
    orientation = Orientation(
        focal_px=float(camera.K[0, 0]),
        tilt_rad=camera.tilt_rad,
        roll_rad=camera.roll_rad,
        tilt_sigma_rad=float(_SLOPE_SIGMA_RAD),
        roll_sigma_rad=float(_SLOPE_SIGMA_RAD),
    )
    options = CalibrateOptions(lens=camera.lens, orientation=orientation)
    found = solve_segments(segments, published.image_size, options)
    if found.reason is not None:
        return Ground(name, published, published, found.reason)
    return Ground(name, published, found)


def _thinned(annotated: Sequence[Detections]) -> Detections:
    """A sighting a second of everything, with numbers of its own in every clip."""
    parts, number = [], 0
    for one in annotated:
        some = one.select(one.frame % EVERY == 0)
        parts.append(replace(some, track=some.track + number))
        number += int(one.track.max(initial=0)) + 1
    return Detections.concatenate(parts)
