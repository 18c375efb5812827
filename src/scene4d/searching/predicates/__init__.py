"""Probabilities of what happens in space and time; pure functions of arrays."""

from scene4d.searching.predicates.distance import NEAR_SIGMA_M, NEAR_TAU_M, near_probability
from scene4d.searching.predicates.pairs import near_pairs
from scene4d.searching.predicates.rows import Rows, Stage

__all__ = ["NEAR_SIGMA_M", "NEAR_TAU_M", "Rows", "Stage", "near_pairs", "near_probability"]
