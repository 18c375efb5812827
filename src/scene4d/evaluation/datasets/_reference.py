"""What is known to be true of a recording: its ground, and where people walked."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.geometry import rigid_fit
from scene4d.core.ground_map import GroundMap
from scene4d.evaluation.measures._correspondence import (
    POINTS,
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluation.measures._near import NearPairs, near_pairs
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera

MAX_PEOPLE = 2000
"""At most so many annotated feet enter P(near), evenly over the clip. Chosen by hand, for time and
memory; a test sees that other numbers give the same AUC."""


@dataclass(frozen=True)
class Published:
    """What Wagner et al. (2019) report for a data set."""

    mean_m: float
    sd_m: float
    person_height_m: float
    auc: float
    auc_height_m: float
    frames: int

    def to_dict(self) -> dict[str, object]:
        """Content of ``evaluation.json``."""
        return {
            "source": "Wagner, Crispell, Feeney, Mundy (2019)",
            "correspondence_error_m": {"mean": self.mean_m, "sd": self.sd_m},
            "person_height_m": self.person_height_m,
            "auc": self.auc,
            "auc_person_height_m": self.auc_height_m,
            "frames": self.frames,
        }


PUBLISHED: dict[str, Published] = {
    "towncentre": Published(1.18, 0.67, 1.8288, 0.98, 1.7018, 1000),
    "virat": Published(2.166, 1.0772, 1.8288, 0.98, 1.8288, 500),
}
"""By data set; the paper does not report PETS."""


@dataclass(frozen=True, eq=False)
class Meetings:
    """People (n, 2) and vehicles (m, 2) in pixels, and the rows of both that form a pair (p, 2)."""

    person_uv: Float[np.ndarray, "n 2"]
    vehicle_uv: Float[np.ndarray, "m 2"]
    rows: Int[np.ndarray, "p 2"]

    @classmethod
    def every(
        cls, person_uv: Float[np.ndarray, "n 2"], vehicle_uv: Float[np.ndarray, "m 2"]
    ) -> "Meetings":
        """Everybody with every vehicle."""
        rows = np.indices((len(person_uv), len(vehicle_uv))).reshape(2, -1).T
        return cls(person_uv, vehicle_uv, rows)


@dataclass(frozen=True, eq=False)
class Reference:
    """A true camera, or a true map of the ground alone, with the annotated feet (n, 2).

    ``feet_uv`` is in pixels of the footage as decoded. ``vehicle_uv`` (m, 2) holds the ground
    points of annotated vehicles, if there are any; else the correspondence points stand in for
    them, as in the paper. ``meetings`` replaces the pairs of everybody with all of these.
    ``n_points`` is the number of correspondence points.
    """

    name: str
    truth: Camera | GroundMap
    feet_uv: Float[np.ndarray, "n 2"]
    vehicle_uv: Float[np.ndarray, "m 2"] | None = None
    n_points: int = POINTS
    meetings: Meetings | None = None

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
        """The feet that are visible (not below the picture) and on the ground."""
        inside = self.feet_uv[:, 1] <= self.image_size[1] - 1
        return self.feet_uv[inside & self.locate(self.feet_uv)[1]]

    @cached_property
    def points_uv(self) -> Float[np.ndarray, "k 2"]:
        """Correspondence points: spread over where people walked, in pixels of the footage.

        Raises :class:`InputError` where there are fewer feet than points.
        """
        return self.walked_uv[spread_points(self.locate(self.walked_uv)[0], self.n_points)]

    def score(self, estimated: Camera, *, undistorted: bool = False) -> CorrespondenceError:
        """Correspondence error of a camera.

        ``undistorted`` says that it was calibrated on footage that had been undistorted with the
        true lens. Raises :class:`InputError` as :func:`.correspondence_error` and
        :attr:`points_uv`, and for a camera of images of another size.
        """
        self._same_size(estimated.image_size)
        uv = self._calibrated_uv(self.points_uv, undistorted)
        estimated_xy, _ = estimated.locate(uv)
        return correspondence_error(estimated_xy, self.locate(self.points_uv)[0])

    def predicted_m(self, found: Calibration, *, undistorted: bool = False) -> float:
        """Root-mean-square error that the calibration itself predicts for :meth:`score`.

        At the same points and after the same alignment, from its covariance alone. NaN where a
        point has none. Raises :class:`InputError` for a calibration without a covariance.
        """
        uv = self._calibrated_uv(self.points_uv, undistorted)
        covariance, _ = found.ground_covariance(uv, aligned_over_uv=uv)
        return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))

    def near(self, found: Calibration, *, undistorted: bool = False) -> NearPairs:
        """P(near) of people and vehicles by a calibration, beside their true distances.

        Raises :class:`InputError` where there is no camera, or one for images of another size.
        """
        self._same_size(found.image_size)
        met, true_m = self.judged
        person_uv = self._calibrated_uv(met.person_uv, undistorted)
        vehicle_uv = self._calibrated_uv(met.vehicle_uv, undistorted)
        pairs = near_pairs(found, person_uv, vehicle_uv, met.rows, true_m)
        return replace(pairs, placed_m=self._placed_m(found, person_uv, undistorted))

    def _placed_m(
        self, found: Calibration, person_uv: Float[np.ndarray, "n 2"], undistorted: bool
    ) -> Float[np.ndarray, "p"] | None:
        """Distances of the pairs with people by the aligned calibration and vehicles where they
        truly are; None where too few correspondence points are on its ground.
        """
        here, _, seen = found.ground_jacobian(self._calibrated_uv(self.points_uv, undistorted))
        if seen.sum() < 2:
            return None
        R, t = rigid_fit(here[seen], self.locate(self.points_uv)[0][seen])
        met, _ = self.judged
        i, j = met.rows.T
        people = found.ground_jacobian(person_uv)[0] @ R.T + t
        apart: np.ndarray = np.hypot(*(people[i] - self.locate(met.vehicle_uv)[0][j]).T)
        return np.where(np.isnan(apart), np.inf, apart)

    @cached_property
    def judged(self) -> tuple[Meetings, Float[np.ndarray, "p"]]:
        """The pairs that :meth:`near` is about, and their true distances (m)."""
        met = self._everybody() if self.meetings is None else self.meetings
        i, j = met.rows.T
        apart = self.locate(met.person_uv)[0][i] - self.locate(met.vehicle_uv)[0][j]
        return met, np.hypot(*apart.T)

    def _everybody(self) -> Meetings:
        people = self.walked_uv[:: max(1, -(-len(self.walked_uv) // MAX_PEOPLE))]
        if self.vehicle_uv is not None:
            return Meetings.every(people, self.vehicle_uv[self.locate(self.vehicle_uv)[1]])
        met = Meetings.every(people, self.points_uv)
        # The points are some of the feet: by any camera, none is away from itself.
        i, j = met.rows.T
        other = (people[i] != self.points_uv[j]).any(axis=1)
        return Meetings(people, self.points_uv, met.rows[other])

    def _calibrated_uv(
        self, uv: Float[np.ndarray, "n 2"], undistorted: bool
    ) -> Float[np.ndarray, "n 2"]:
        """Pixels of the footage as the calibrated footage shows them. A map of the ground has no
        lens to undistort with.
        """
        if not undistorted or isinstance(self.truth, GroundMap):
            return uv
        return self.truth.undistort(uv)[0]

    def _same_size(self, image_size: tuple[int, int]) -> None:
        if image_size != self.image_size:
            (w, h), (true_w, true_h) = image_size, self.image_size
            raise InputError(
                f"{self.name}: the calibration is for {w}x{h} images and the reference for "
                f"{true_w}x{true_h}: calibrate footage of the reference's size"
            )


def pets(data: str | Path) -> Reference:
    """PETS 2009 S2.L1 View_001: Tsai camera and hand-drawn boxes; ``data`` holds their files."""
    folder = Path(data)
    return _reference("PETS 2009", folder / "View_001.xml", folder / "PETS2009-S2L1.xml")


def towncentre(data: str | Path) -> Reference:
    """TownCentre: camera and annotated feet. The boxes' heights are circular and not used."""
    folder = Path(data)
    return _reference(
        "TownCentre", folder / "TownCentre-calibration.ci", folder / "TownCentreGTHalfRes.csv"
    )


def _reference(name: str, camera_file: Path, annotations: Path) -> Reference:
    camera = read_camera(camera_file)
    if not isinstance(camera, Camera):
        raise InputError(f"{camera_file}: holds a lens without a pose, and cannot be a reference")
    boxes = read_annotations(annotations, image_size=camera.image_size)
    return Reference(name, camera, boxes.box_foot_uv)
