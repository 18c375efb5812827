"""P(near) of people and places: the ROC experiment of Wagner et al. (2019), section 4."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.calibration import Calibration
from scene4d.evaluation.measures._probability import brier_score, reliability, roc_curve
from scene4d.searching.predicates import NEAR_SIGMA_M, NEAR_TAU_M, near_probability


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of a person and a place (p,): true and estimated distance (m), and the standard
    deviation that the calibration predicts for the estimated distance.

    The estimated distance is infinite where the estimated camera sees an end above its horizon.
    ``placed_m`` is how far the person, on the estimated ground aligned with the true one, is from
    the place's true position: there a wrong scale shows, which distances within one scene hide.
    """

    true_m: Float[np.ndarray, "p"]
    estimated_m: Float[np.ndarray, "p"]
    sigma_m: Float[np.ndarray, "p"]
    tau_m: float = NEAR_TAU_M
    placed_m: Float[np.ndarray, "p"] | None = None

    def select(self, rows: Bool[np.ndarray, "p"]) -> "NearPairs":
        """Some of the pairs."""
        placed_m = None if self.placed_m is None else self.placed_m[rows]
        return NearPairs(
            self.true_m[rows], self.estimated_m[rows], self.sigma_m[rows], self.tau_m, placed_m
        )

    @property
    def ranked_m(self) -> Float[np.ndarray, "p"]:
        """The distance by which an ROC curve ranks the pairs: ``placed_m`` where it is known.

        Pairs are ranked by distance, so that far pairs, whose P(near) underflows, stay in order.
        """
        return self.estimated_m if self.placed_m is None else self.placed_m

    @property
    def positive(self) -> Bool[np.ndarray, "p"]:
        """Whether the two are truly near: closer than ``tau_m``."""
        return self.true_m < self.tau_m

    @property
    def auc(self) -> float | None:
        """Area under the ROC curve; None where all pairs are near, or none."""
        return _auc(-self.ranked_m, self.positive)

    def readings(self) -> dict[str, Float[np.ndarray, "p"]]:
        """Three probabilities of being near.

        ``paper`` takes distances as exact, ``expected`` is E[P(near)] under the position
        covariance, ``below_tau`` the probability that the true distance is below τ. Only the last
        one is what :attr:`positive` asks: with a softness σ > 0 the other two hedge even where a
        distance is exact.
        """
        return {
            "paper": self._probability(distance_sigma_m=0.0),
            "expected": self._probability(distance_sigma_m=self.sigma_m),
            "below_tau": self._probability(distance_sigma_m=self.sigma_m, sigma_m=0.0),
        }

    def brier(self) -> dict[str, float]:
        """Brier score of each of :meth:`readings`."""
        return {name: brier_score(p, self.positive) for name, p in self.readings().items()}

    def to_dict(self) -> dict[str, Any]:
        """Content of ``evaluation.json``: AUC, Brier score and calibration error.

        All pairs share the few errors of one camera, so Brier score and calibration error of one
        recording are a single draw, however many pairs there are. ``auc_within_two_tau`` leaves
        out the pairs that are truly far and easy to tell.
        """
        true = self.positive
        readings = self.readings()
        return {
            "pairs": len(true),
            "near": int(true.sum()),
            "tau_m": self.tau_m,
            "auc": self.auc,
            "auc_within_two_tau": self.select(self.true_m < 2 * self.tau_m).auc,
            "auc_expected": _auc(readings["expected"], true),
            "brier": self.brier(),
            "calibration_error": {
                name: reliability(p, true).expected_error for name, p in readings.items()
            },
        }

    def _probability(
        self, *, distance_sigma_m: float | np.ndarray, sigma_m: float = NEAR_SIGMA_M
    ) -> Float[np.ndarray, "p"]:
        return near_probability(
            self.estimated_m, tau_m=self.tau_m, sigma_m=sigma_m, distance_sigma_m=distance_sigma_m
        )


def _auc(score: np.ndarray, true: np.ndarray) -> float | None:
    return roc_curve(score, true).auc if true.any() and not true.all() else None


def near_pairs(
    calibration: Calibration,
    person_uv: Float[np.ndarray, "n 2"],
    place_uv: Float[np.ndarray, "m 2"],
    rows: Int[np.ndarray, "p 2"],
    true_m: Float[np.ndarray, "p"],
    *,
    tau_m: float = NEAR_TAU_M,
) -> NearPairs:
    """Pairs of people and places by a calibration, in pixels of the footage that it is for.

    ``rows`` are the row of the person and that of the place of each pair, ``true_m`` its true
    distance. The spread of a distance is first order in the camera's parameters; errors that move
    both ends alike cancel. It holds no error of the pixels: the truth uses the same ones. Raises
    :class:`InputError` where there is no camera.
    """
    person, by_person, person_ok = calibration.ground_jacobian(person_uv)
    place, by_place, place_ok = calibration.ground_jacobian(place_uv)
    i, j = rows.T
    apart = person[i] - place[j]
    distance = np.hypot(*apart.T)
    towards = apart / np.maximum(distance, 1e-9)[:, None]
    slope = np.einsum("pi,piq->pq", towards, by_person[i] - by_place[j])
    variance = np.einsum("pq,qr,pr->p", slope, calibration.parameter_covariance, slope)
    seen = person_ok[i] & place_ok[j]
    return NearPairs(
        true_m=true_m,
        estimated_m=np.where(seen, distance, np.inf),
        sigma_m=np.where(seen, np.sqrt(np.maximum(variance, 0)), 0.0),
        tau_m=tau_m,
    )
