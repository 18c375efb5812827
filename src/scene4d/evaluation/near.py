"""P(near) of people and places: the ROC experiment of Wagner et al. (2019), section 4."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.calibration import Calibration
from scene4d.searching.predicates import NEAR_SIGMA_M, NEAR_TAU_M, near_probability


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of a person and a place (p,): true and estimated distance (m), and the standard
    deviation that the calibration expects of the latter.

    A pair of which the estimated camera sees one end above its horizon is infinitely far apart.
    """

    true_m: Float[np.ndarray, "p"]
    estimated_m: Float[np.ndarray, "p"]
    sigma_m: Float[np.ndarray, "p"]
    tau_m: float = NEAR_TAU_M

    def select(self, rows: Bool[np.ndarray, "p"]) -> "NearPairs":
        """Some of the pairs."""
        return NearPairs(
            self.true_m[rows], self.estimated_m[rows], self.sigma_m[rows], tau_m=self.tau_m
        )

    @property
    def positive(self) -> Bool[np.ndarray, "p"]:
        """Whether the two are truly near: closer than ``tau_m``."""
        return self.true_m < self.tau_m

    def as_paper(self) -> Float[np.ndarray, "p"]:
        """P(near) of the estimated distance, as if it were exact."""
        return near_probability(self.estimated_m, tau_m=self.tau_m)

    def expected(self, *, sigma_m: float = NEAR_SIGMA_M) -> Float[np.ndarray, "p"]:
        """E[P(near)] under the position covariance; with ``sigma_m = 0`` the probability that the
        true distance is below ``tau_m``.
        """
        return near_probability(
            self.estimated_m, tau_m=self.tau_m, sigma_m=sigma_m, distance_sigma_m=self.sigma_m
        )


def near_pairs(
    calibration: Calibration,
    person_uv: Float[np.ndarray, "n 2"],
    place_uv: Float[np.ndarray, "m 2"],
    true_m: Float[np.ndarray, "n m"],
    *,
    tau_m: float = NEAR_TAU_M,
) -> NearPairs:
    """All n x m pairs of people and places, in pixels of the footage that was calibrated.

    The spread of a distance is first order in the camera's parameters; what moves both ends alike
    cancels, so it vanishes with the distance. It holds no error of the pixels: the truth looks
    through the same ones. Raises :class:`InputError` where there is no camera.
    """
    person, by_person, person_ok = calibration.ground_jacobian(person_uv)
    place, by_place, place_ok = calibration.ground_jacobian(place_uv)
    apart = person[:, None] - place[None]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    towards = apart / np.maximum(distance, 1e-9)[..., None]
    slope = np.einsum("nmi,nip->nmp", towards, by_person)
    slope -= np.einsum("nmi,mip->nmp", towards, by_place)
    covariance = calibration.parameter_covariance
    variance = np.einsum("nmp,pq,nmq->nm", slope, covariance, slope)
    seen = person_ok[:, None] & place_ok[None]
    return NearPairs(
        true_m=true_m.ravel(),
        estimated_m=np.where(seen, distance, np.inf).ravel(),
        sigma_m=np.where(seen, np.sqrt(np.maximum(variance, 0)), 0.0).ravel(),
        tau_m=tau_m,
    )
