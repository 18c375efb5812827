"""Probabilities of what happens in space and time; pure functions of arrays."""

from scene4d.predicates.distance import NEAR_SIGMA_M, NEAR_TAU_M, near_probability

__all__ = ["NEAR_SIGMA_M", "NEAR_TAU_M", "near_probability"]
