"""``search``: from scenes to stages, which predicates look at."""

from scene4d.pipeline.searching.staging import STEP_S, Staged, stage_of

__all__ = ["STEP_S", "Staged", "stage_of"]
