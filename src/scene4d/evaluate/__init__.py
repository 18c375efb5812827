"""How far a calibration is from the truth, by the paper's measures."""

from scene4d.evaluate.correspondence import (
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.evaluate.datasets import Reference, pets, towncentre

__all__ = [
    "CorrespondenceError",
    "Reference",
    "correspondence_error",
    "pets",
    "spread_points",
    "towncentre",
]
