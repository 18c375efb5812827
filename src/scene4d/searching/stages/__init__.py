"""``search``: from scenes to stages, which predicates look at."""

from scene4d.searching.stages.staging import STEP_S, Staged, stage_of

__all__ = ["STEP_S", "Staged", "stage_of"]
