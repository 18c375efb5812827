"""Measured against truth: cameras and searches, on data sets that publish it, and on your own.

Read in this order: ``datasets`` (what is true) → ``trials`` (what is tried on it) → ``measures``
(how far off it is) → ``pages`` (how that is shown).
"""

from scene4d.evaluation.datasets.reference import PUBLISHED, Reference, pets, towncentre
from scene4d.evaluation.measures.correspondence import (
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluation.options import EvaluateOptions
from scene4d.evaluation.trials.activities import evaluate_meva
from scene4d.evaluation.trials.cameras import (
    evaluate_custom,
    evaluate_pets,
    evaluate_towncentre,
    evaluate_virat,
)

__all__ = [
    "PUBLISHED",
    "CorrespondenceError",
    "EvaluateOptions",
    "Reference",
    "correspondence_error",
    "evaluate_custom",
    "evaluate_meva",
    "evaluate_pets",
    "evaluate_towncentre",
    "evaluate_virat",
    "pets",
    "spread_points",
    "towncentre",
]
