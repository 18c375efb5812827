"""What an evaluation found, row by row, beside what the paper published."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.evaluation.correspondence import CorrespondenceError
from scene4d.evaluation.few_people import FewPeople
from scene4d.evaluation.near import NearPairs
from scene4d.evaluation.probability import brier_score, reliability, roc_curve
from scene4d.evaluation.reference import Reference

PAPER_HEIGHTS_M = (1.5748, 1.7018, 1.8288)
"""Mean heights of people for which the paper gives results (5'2", 5'7", 6'0")."""


@dataclass(frozen=True)
class Published:
    """What Wagner et al. (2019) report for a data set."""

    mean_m: float
    sd_m: float
    person_height_m: float
    auc: float
    auc_height_m: float
    frames: int


PUBLISHED: dict[str, Published] = {
    "towncentre": Published(1.18, 0.67, 1.8288, 0.98, 1.7018, 1000),
    "virat": Published(2.166, 1.0772, 1.8288, 0.98, 1.8288, 500),
}
"""By data set; the paper does not report PETS."""


@dataclass(frozen=True)
class Setting:
    """One line of the table: what was looked at, how, and what was told beforehand.

    ``circular`` inputs were generated from the true calibration: whatever fits them proves nothing,
    so they are shown and left out of every claim. ``headline`` marks, before anything is measured,
    the lines that figures and summaries should show.
    """

    footage: str
    method: str
    given: str
    circular: bool = False
    headline: bool = False


@dataclass(frozen=True, eq=False)
class Outcome:
    """A setting at one mean height of people. ``reason`` says why there is no result.

    ``predicted_m`` is the root-mean-square error that the calibration expects of itself at the
    correspondence points (:meth:`.Reference.predicted_m`); it is conditional on what was told.
    """

    setting: Setting
    person_height_m: float
    calibration: Calibration | None = None
    reason: str | None = None
    error: CorrespondenceError | None = None
    predicted_m: float | None = None
    near: NearPairs | None = None

    @classmethod
    def scored(cls, setting: Setting, found: Calibration, reference: Reference) -> "Outcome":
        """The calibration against the reference; a refusal, or a camera that has a correspondence
        point above its horizon, is an outcome with its reason.
        """
        height = found.person_height_m
        if not found or found.camera is None:
            return cls(setting, height, found, found.reason)
        try:
            error = reference.score(found.camera)
        except InputError as failure:
            return cls(setting, height, found, str(failure))
        known = bool(found.parameter_covariance.any())  # a given camera says nothing of its errors
        predicted = reference.predicted_m(found) if known else None
        near = reference.near(found)
        return cls(setting, height, found, None, error, predicted, near)

    def to_dict(self) -> dict[str, Any]:
        """One row of ``evaluation.json``; angles in degrees, as in ``camera.json``."""
        setting, found = self.setting, self.calibration
        row: dict[str, Any] = {
            "footage": setting.footage,
            "method": setting.method,
            "given": setting.given,
            "circular": setting.circular,
            "person_height_m": self.person_height_m,
            "status": "ok" if self.error is not None else "refused",
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
        if self.error is not None:
            row["correspondence_error_m"] = {
                "mean": self.error.mean_m,
                "sd": self.error.sd_m,
                "rms": self.error.rms_m,
                "predicted_rms": self.predicted_m,
            }
        if self.near is not None:
            row["near"] = near_figures(self.near)
        return row


def near_figures(pairs: NearPairs) -> dict[str, Any]:
    """AUC of P(near), and Brier score and calibration error of three readings of it.

    ``paper`` takes distances as exact, ``expected`` is E[P(near)] under the position covariance,
    ``below_tau`` the probability that the true distance is below τ. Only the last states what is
    scored here: with a softness σ > 0 the other two hedge even when every distance is exact. AUC
    sees the order alone: a map at a wrong scale keeps it. All pairs share one camera's few errors,
    so calibration and Brier score of one recording are a single draw, however many pairs there are.
    AUC is None where all pairs are near, or none; ``auc_within_two_tau`` leaves out the pairs that
    are truly far and easy to tell.
    """
    true = pairs.positive
    hard = pairs.select(pairs.true_m < 2 * pairs.tau_m)
    readings = {
        "paper": pairs.as_paper(),
        "expected": pairs.expected(),
        "below_tau": pairs.expected(sigma_m=0.0),
    }
    return {
        "pairs": len(true),
        "near": int(true.sum()),
        "tau_m": pairs.tau_m,
        # Ranked by distance itself: far pairs, whose P(near) underflows, stay in order.
        "auc": _auc(-pairs.estimated_m, true),
        "auc_within_two_tau": _auc(-hard.estimated_m, hard.positive),
        "auc_expected": _auc(readings["expected"], true),
        "brier": {name: brier_score(p, true) for name, p in readings.items()},
        "calibration_error": {
            name: reliability(p, true).expected_error for name, p in readings.items()
        },
    }


def _auc(score: np.ndarray, true: np.ndarray) -> float | None:
    return roc_curve(score, true).auc if true.any() and not true.all() else None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All outcomes on one data set. ``image_bgr`` (h, w, 3) is a picture of the scene, ``notes``
    say what was left out and why, ``few`` are draws of a few people from single frames.
    """

    name: str
    reference: Reference
    outcomes: tuple[Outcome, ...]
    published: Published | None = None
    image_bgr: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    few: tuple[FewPeople, ...] = ()

    def settings(self) -> list[Setting]:
        """The lines of the table, in order."""
        return list(dict.fromkeys(outcome.setting for outcome in self.outcomes))

    def of(self, setting: Setting) -> list[Outcome]:
        """The outcomes of one line, one per mean height of people."""
        return [outcome for outcome in self.outcomes if outcome.setting == setting]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``evaluation.json``."""
        published = None
        if self.published is not None:
            p = self.published
            published = {
                "source": "Wagner, Crispell, Feeney, Mundy (2019)",
                "correspondence_error_m": {"mean": p.mean_m, "sd": p.sd_m},
                "person_height_m": p.person_height_m,
                "auc": p.auc,
                "auc_person_height_m": p.auc_height_m,
                "frames": p.frames,
            }
        return {
            "dataset": self.name,
            "reference": self.reference.name,
            "correspondence_points": len(self.reference.points_uv),
            "published": published,
            "rows": [outcome.to_dict() for outcome in self.outcomes],
            "few_people": [row.to_dict() for row in self.few],
            "notes": list(self.notes),
        }
