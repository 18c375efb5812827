"""How far a calibration is from the truth, by the paper's measures and those it left out."""

from scene4d.evaluation.correspondence import (
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluation.datasets import pets, towncentre
from scene4d.evaluation.evaluation import (
    PAPER_HEIGHTS_M,
    PUBLISHED,
    Evaluation,
    Outcome,
    Published,
    Setting,
    near_figures,
)
from scene4d.evaluation.few_people import FewPeople, few_error_m, median_m
from scene4d.evaluation.near import NearPairs, near_pairs
from scene4d.evaluation.probability import Reliability, Roc, brier_score, reliability, roc_curve
from scene4d.evaluation.reference import Reference
from scene4d.evaluation.virat_clips import SameFrameReference, ViratScene, spread_frames, virat

__all__ = [
    "PAPER_HEIGHTS_M",
    "PUBLISHED",
    "CorrespondenceError",
    "Evaluation",
    "FewPeople",
    "NearPairs",
    "Outcome",
    "Published",
    "Reference",
    "Reliability",
    "Roc",
    "SameFrameReference",
    "Setting",
    "ViratScene",
    "brier_score",
    "correspondence_error",
    "few_error_m",
    "median_m",
    "near_figures",
    "near_pairs",
    "pets",
    "reliability",
    "roc_curve",
    "spread_frames",
    "spread_points",
    "towncentre",
    "virat",
]
