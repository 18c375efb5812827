"""What is known to be true of a recording: its ground, and where people walked."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.evaluation.correspondence import (
    POINTS,
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluation.near import NearPairs, near_pairs

MAX_PEOPLE = 2000
"""At most so many annotated feet enter P(near), evenly over the clip: more say the same again."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A true camera, or a true map of the ground alone, with the annotated feet (n, 2).

    ``feet_uv`` is in pixels of the footage as decoded. ``vehicle_uv`` (m, 2) holds the ground
    points of annotated vehicles, where there are any; else the correspondence points stand in for
    them, as in the paper. ``n_points`` is the number of correspondence points.
    """

    name: str
    truth: Camera | GroundMap
    feet_uv: Float[np.ndarray, "n 2"]
    vehicle_uv: Float[np.ndarray, "m 2"] | None = None
    n_points: int = POINTS

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the footage."""
        return self.truth.image_size

    @cached_property
    def camera(self) -> Camera:
        """The true camera; of a map of the ground, the one whose ground that is.

        Raises :class:`InputError` where there is none (:func:`.pose_from_homography`).
        """
        return self.truth.camera() if isinstance(self.truth, GroundMap) else self.truth

    def locate(
        self, uv: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """True ground positions of pixels of the footage."""
        return self.truth.locate(uv)

    @cached_property
    def walked_uv(self) -> Float[np.ndarray, "n 2"]:
        """The feet that are seen (not below the picture) and stand on the ground."""
        inside = self.feet_uv[:, 1] <= self.image_size[1] - 1
        return self.feet_uv[inside & self.locate(self.feet_uv)[1]]

    @cached_property
    def points_uv(self) -> Float[np.ndarray, "k 2"]:
        """Correspondence points: spread over where people walked, in pixels of the footage.

        Raises :class:`InputError` where there are fewer than that.
        """
        return self.walked_uv[spread_points(self.locate(self.walked_uv)[0], self.n_points)]

    def in_frame_of(
        self, uv: Float[np.ndarray, "n 2"], *, undistorted: bool
    ) -> Float[np.ndarray, "n 2"]:
        """Pixels of the footage as the calibrated one shows them: ``undistorted`` says that it had
        been straightened with the true lens. A map of the ground has no lens to do so.
        """
        if not undistorted or isinstance(self.truth, GroundMap):
            return uv
        return self.truth.undistort(uv)[0]

    def score(self, estimated: Camera, *, undistorted: bool = False) -> CorrespondenceError:
        """Correspondence error of a calibration; see :meth:`in_frame_of` for ``undistorted``.

        Raises :class:`InputError` as :func:`.correspondence_error` and :attr:`points_uv`, and
        where the calibration is for images of another size.
        """
        self._same_size(estimated.image_size)
        uv = self.in_frame_of(self.points_uv, undistorted=undistorted)
        estimated_xy, _ = estimated.locate(uv)
        return correspondence_error(estimated_xy, self.locate(self.points_uv)[0])

    def predicted_m(self, found: Calibration, *, undistorted: bool = False) -> float:
        """Root-mean-square error that the calibration itself expects of :meth:`score`.

        At the same points and after the same alignment, from its covariance alone. NaN where a
        point has none.
        """
        uv = self.in_frame_of(self.points_uv, undistorted=undistorted)
        covariance, _ = found.ground_covariance(uv, aligned_over_uv=uv)
        return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))

    def near(self, found: Calibration, *, undistorted: bool = False) -> NearPairs:
        """P(near) of people and vehicles by a calibration, beside their true distances.

        Raises :class:`InputError` where there is no camera, or one for images of another size.
        """
        self._same_size(found.image_size)
        people = self.walked_uv[:: max(1, -(-len(self.walked_uv) // MAX_PEOPLE))]
        places = self.points_uv if self.vehicle_uv is None else self.vehicle_uv
        places = places[self.locate(places)[1]]
        apart = self.locate(people)[0][:, None] - self.locate(places)[0][None]
        pairs = near_pairs(
            found,
            self.in_frame_of(people, undistorted=undistorted),
            self.in_frame_of(places, undistorted=undistorted),
            np.hypot(apart[..., 0], apart[..., 1]),
        )
        if self.vehicle_uv is not None:
            return pairs
        # The points are some of the feet: no distance from themselves by any camera.
        return pairs.select((people[:, None] != places[None]).any(axis=2).ravel())

    def _same_size(self, image_size: tuple[int, int]) -> None:
        if image_size != self.image_size:
            (w, h), (true_w, true_h) = image_size, self.image_size
            raise InputError(
                f"{self.name}: the calibration is for {w}x{h} images and the reference for "
                f"{true_w}x{true_h}: calibrate footage of the reference's size"
            )
