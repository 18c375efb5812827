"""Measured against truth: cameras and searches, on data sets that publish it, and on your own.

Read in this order: ``datasets`` (what is true) → ``trials`` (what is tried on it) → ``measures``
(how far off it is) → ``pages`` (how that is shown).
"""

from scene4d.evaluation._options import EvaluateOptions
from scene4d.evaluation.datasets._reference import PUBLISHED, Reference, pets, towncentre
from scene4d.evaluation.measures._correspondence import (
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluation.trials._cameras import (
    evaluate_custom,
    evaluate_footage,
    evaluate_pets,
    evaluate_towncentre,
    evaluate_virat,
)
from scene4d.evaluation.trials.activities import evaluate_meva
from scene4d.evaluation.trials.sites import SiteEvaluation, evaluate_site

__all__ = [
    "PUBLISHED",
    "CorrespondenceError",
    "EvaluateOptions",
    "Reference",
    "SiteEvaluation",
    "correspondence_error",
    "evaluate_custom",
    "evaluate_footage",
    "evaluate_meva",
    "evaluate_pets",
    "evaluate_site",
    "evaluate_towncentre",
    "evaluate_virat",
    "pets",
    "spread_points",
    "towncentre",
]
