"""Probabilities of what happens in space and time; pure functions of arrays."""

from scene4d.searching.predicates._distance import NEAR_SIGMA_M, NEAR_TAU_M, near_probability
from scene4d.searching.predicates.stage import Stage, StageRows

__all__ = ["NEAR_SIGMA_M", "NEAR_TAU_M", "Stage", "StageRows", "near_probability"]
