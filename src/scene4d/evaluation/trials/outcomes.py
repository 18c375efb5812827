"""What an evaluation of cameras found, row by row, beside what the paper published."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.evaluation.datasets._reference import PUBLISHED, Published, Reference
from scene4d.evaluation.measures._correspondence import CorrespondenceError
from scene4d.evaluation.measures._near import NearPairs

PAPER_HEIGHTS_M = (1.5748, 1.7018, 1.8288)
"""Mean heights of people for which the paper gives results (5'2", 5'7", 6'0")."""


@dataclass(frozen=True)
class Setting:
    """One line of the table: the footage, the method, and what it was given beforehand.

    ``circular`` inputs were generated from the true calibration: what fits them proves nothing, so
    they are shown and left out of every claim. ``headline`` marks, before anything is measured,
    the lines that figures and summaries show.
    """

    footage: str
    method: str
    given: str
    circular: bool = False
    headline: bool = False


@dataclass(frozen=True, eq=False)
class Score:
    """A camera against the truth.

    ``predicted_m`` is the root-mean-square error that the calibration predicts for itself at the
    correspondence points (:meth:`.Reference.predicted_m`), conditional on what was given; None for
    a camera without a covariance.
    """

    camera: Camera
    error: CorrespondenceError
    near: NearPairs
    predicted_m: float | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """A setting at one mean height of people; without a ``score`` there is a ``reason``."""

    setting: Setting
    person_height_m: float
    calibration: Calibration | None = None
    score: Score | None = None
    reason: str | None = None

    @classmethod
    def scored(cls, setting: Setting, found: Calibration, reference: Reference) -> "Outcome":
        """The calibration against the reference; a refusal, or a camera that has a correspondence
        point above its horizon, is an outcome with its reason.
        """
        height, camera = found.person_height_m, found.camera
        if not found or camera is None:
            return cls(setting, height, found, reason=found.reason)
        try:
            error = reference.score(camera)
        except InputError as failure:
            return cls(setting, height, found, reason=str(failure))
        known = bool(found.parameter_covariance.any())
        predicted = reference.predicted_m(found) if known else None
        return cls(setting, height, found, Score(camera, error, reference.near(found), predicted))

    def to_dict(self) -> dict[str, Any]:
        """One row of ``evaluation.json``; angles in degrees, as in ``camera.json``."""
        setting, found = self.setting, self.calibration
        row: dict[str, Any] = {
            "footage": setting.footage,
            "method": setting.method,
            "given": setting.given,
            "circular": setting.circular,
            "person_height_m": self.person_height_m,
            "status": "ok" if self.score is not None else "refused",
        }
        if self.reason is not None:
            row["reason"] = self.reason
        if found is not None and found.camera is not None:
            camera = found.camera
            row |= {
                "focal_px": camera.focal_px,
                "tilt_deg": float(np.degrees(camera.tilt_rad)),
                "roll_deg": float(np.degrees(camera.roll_rad)),
                "height_m": camera.height_m,
                "sigma": found.sigma,
                "people": found.people,
                "inliers": found.inliers,
            }
        if self.score is not None:
            row["correspondence_error_m"] = {
                "mean": self.score.error.mean_m,
                "sd": self.score.error.sd_m,
                "rms": self.score.error.rms_m,
                "predicted_rms": self.score.predicted_m,
            }
            row["near"] = self.score.near.to_dict()
        return row


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All outcomes on one data set. ``image_bgr`` (h, w, 3) is a picture of the scene, ``notes``
    say what was left out and why.
    """

    name: str
    reference: Reference
    outcomes: tuple[Outcome, ...]
    image_bgr: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @property
    def published(self) -> Published | None:
        """What the paper reports for this data set."""
        return PUBLISHED.get(self.name)

    def settings(self) -> list[Setting]:
        """The lines of the table, in order."""
        return list(dict.fromkeys(outcome.setting for outcome in self.outcomes))

    def heights_m(self) -> list[float]:
        """The mean heights of people that were assumed, ascending."""
        return sorted({outcome.person_height_m for outcome in self.outcomes})

    def of(self, setting: Setting) -> list[Outcome]:
        """The outcomes of one line, one per mean height of people."""
        return [outcome for outcome in self.outcomes if outcome.setting == setting]

    def to_dict(self) -> dict[str, Any]:
        """Content of ``evaluation.json``."""
        return {
            "dataset": self.name,
            "reference": self.reference.name,
            "correspondence_points": len(self.reference.points_uv),
            "published": None if self.published is None else self.published.to_dict(),
            "rows": [outcome.to_dict() for outcome in self.outcomes],
            "notes": list(self.notes),
        }
