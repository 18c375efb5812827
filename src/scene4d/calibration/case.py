"""One calibration: what was seen, what is assumed, and how an answer is put into words."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration.frame import ImageFrame
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments

METHODS = ("joint", "paper")


def check_asked(method: str, person_height_m: float, *, has_orientation: bool) -> None:
    """Refuse what no footage could answer; raises :class:`InputError` naming the argument."""
    if method not in METHODS:
        raise InputError(f"method must be one of {METHODS}, found {method!r}")
    if not 0.5 <= person_height_m <= 2.5:
        raise InputError(f"person_height_m must lie in 0.5 to 2.5 metres, found {person_height_m}")
    if method == "paper" and not has_orientation:
        raise InputError(
            "the paper's method needs the camera's orientation (focal length, tilt, roll): "
            "give --orientation FILE, or use --method joint"
        )


@dataclass(frozen=True, eq=False)
class Assumptions:
    """What is told or believed about camera and people; see :func:`.solve.solve_segments`."""

    person_height_m: float
    foot_height_m: float
    orientation: Orientation | None
    method: str
    lens: Lens | None
    estimate_focal: bool
    estimate_distortion: bool
    lines_xyxy: Float[np.ndarray, "m 4"] | None
    population_sigma_m: float
    systematics: bool
    consensus: str
    seed: int

    @property
    def fixed_focal_px(self) -> float | None:
        """Focal length that the lens tells for sure: it outranks an orientation's."""
        if self.lens is None or self.estimate_focal:
            return None
        return float(self.lens.K[0, 0])


@dataclass(frozen=True, eq=False)
class Case:
    """Segments with the rows (n,) of them that can be used."""

    segments: Segments
    usable: Bool[np.ndarray, "n"]
    frame: ImageFrame
    asked: Assumptions

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


def ground_error(found: Calibration) -> tuple[dict[str, float], float]:
    """Predicted error where people walked: median and p90 (m) within the scene, and the median
    error from the camera over the distance.
    """
    xy, within, from_camera = found.walked_ground_sigma_m()
    if len(xy) == 0:
        return {"median": np.inf, "p90": np.inf}, np.inf
    median, p90 = np.quantile(within, [0.5, 0.9])
    relative = float(np.median(from_camera / np.maximum(np.hypot(*xy.T), 1e-6)))
    return {"median": float(median), "p90": float(p90)}, relative
