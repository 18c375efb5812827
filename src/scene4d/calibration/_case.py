"""One calibration: what was seen, how it maps into the solver's frame, and what comes out."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import CENTRE, CORNER, FOCAL, HEIGHT, ROLL, TILT, Points
from scene4d.calibration.options import CalibrateOptions
from scene4d.core import geometry
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.people import Segments


@dataclass(frozen=True, eq=False)
class ImageFrame:
    """How pixels become the solver's numbers, and its parameters a camera.

    ``lens`` holds the known intrinsics, or None: then the principal point is the image centre,
    pixels are square, and the lens is the solver's one radial coefficient, of a ``fisheye`` or of
    an ordinary lens.
    """

    image_size: tuple[int, int]
    lens: Lens | None = None
    fisheye: bool = False

    @property
    def half_diagonal_px(self) -> float:
        """Half the diagonal of the image, the solver's unit of length."""
        return float(np.hypot(*self.image_size) / 2)

    @property
    def centre_uv(self) -> Float[np.ndarray, "2"]:
        """Assumed principal point in pixels."""
        if self.lens is not None:
            return self.lens.K[:2, 2]
        return (np.array(self.image_size, float) - 1) / 2

    @property
    def aspect(self) -> float:
        """``fy / fx``: how much taller than wide a pixel's image is."""
        return 1.0 if self.lens is None else float(self.lens.K[1, 1] / self.lens.K[0, 0])

    def normalised(self, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 n"]:
        """Undistorted (or, without a lens, footage) pixels to the solver's frame."""
        x, y = (uv - self.centre_uv).T
        if self.lens is not None:
            x = x - self.lens.K[0, 1] / self.lens.K[1, 1] * y  # a skewed sensor made square
        return np.stack([x, y / self.aspect]) / self.half_diagonal_px

    def straight(self, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 n"]:
        """Pixels of the footage in the solver's frame; NaN where the lens has no ray."""
        return self.normalised(uv if self.lens is None else self.lens.undistort(uv)[0])

    def points(self, segments: Segments, foot_height_m: float) -> Points:
        """The solver's view of segments given in footage pixels; unseen ends become NaN."""
        foot, head = self.straight(segments.foot_uv), self.straight(segments.head_uv)
        return Points(foot, head, segments.from_box, foot_height_m, self.fisheye)

    def camera(self, parameters: Float[np.ndarray, "7"]) -> Camera:
        """The camera of a parameter vector (log f, tilt, roll, log h, D, cu, cv)."""
        focal = np.exp(parameters[FOCAL]) * self.half_diagonal_px
        K = np.array([[focal, 0, 0], [0, focal * self.aspect, 0], [0, 0, 1.0]])
        K[:2, 2] = self.centre_uv + parameters[CENTRE] * self.half_diagonal_px * [1, self.aspect]
        model = "fisheye" if self.fisheye else "pinhole"
        if self.lens is None:
            distortion = np.zeros(4 if self.fisheye else 5)
            distortion[0] = parameters[CORNER] * np.exp(2 * parameters[FOCAL])
        else:
            K[0, 1] = self.lens.K[0, 1] * focal / self.lens.K[0, 0]
            stretch = float(focal / self.lens.K[0, 0])
            distortion = geometry.refocused(self.lens.distortion, stretch)
            model = self.lens.distortion_model
        R = geometry.rotation_from_tilt_roll(parameters[TILT], parameters[ROLL])
        t = -R @ np.array([0.0, 0.0, np.exp(parameters[HEIGHT])])
        return Camera(self.image_size, K, distortion, R, t, distortion_model=model)


@dataclass(frozen=True, eq=False)
class Case:
    """Segments of one camera and what is asked about them."""

    segments: Segments
    frame: ImageFrame
    asked: CalibrateOptions

    @cached_property
    def points(self) -> Points:
        """The segments in the solver's frame."""
        return self.frame.points(self.segments, self.asked.foot_height_m)

    @cached_property
    def usable(self) -> Bool[np.ndarray, "n"]:
        """Which segments have two different ends."""
        foot, head = self.points.foot, self.points.head
        seen = np.isfinite(foot).all(axis=0) & np.isfinite(head).all(axis=0)
        return seen & (np.hypot(*(head - foot)) > 1e-6)

    def undetermined(self, reason: str, inlier: np.ndarray | None = None) -> Calibration:
        """The refusal, with its reason."""
        return self._calibration("undetermined", reason=reason, inlier=inlier)

    def found(self, **values: Any) -> Calibration:
        """A calibration with a camera."""
        return self._calibration("ok", **values)

    def over_all(self, values: np.ndarray, elsewhere: Any) -> np.ndarray:
        """Values of the usable rows as a column over all segments."""
        column = np.full(len(self.segments), elsewhere, values.dtype)
        column[self.usable] = values
        return column

    def _calibration(self, status: str, **values: Any) -> Calibration:
        return Calibration(
            status=status,
            method=self.asked.method,
            image_size=self.frame.image_size,
            person_height_m=self.asked.person_height_m,
            segments=self.segments,
            **values,
        )


def saying(found: Calibration, *texts: str) -> Calibration:
    """The calibration with further warnings."""
    return replace(found, warnings=(*found.warnings, *texts))


def different_people(segments: Segments) -> int:
    """How many different people these surely are: each track is one, and of the sightings without
    a track at least those that one frame shows.
    """
    known = segments.track >= 0
    _, at_once = np.unique(segments.frame[~known], return_counts=True)
    return len(np.unique(segments.track[known])) + int(at_once.max(initial=0))
