"""``search``: from scenes to stages, which predicates look at, and events with their frames."""

from scene4d.pipeline.searching.finding import Found, found_in
from scene4d.pipeline.searching.staging import STEP_S, Staged, stage_of, stages

__all__ = ["STEP_S", "Found", "Staged", "found_in", "stage_of", "stages"]
