"""The 4-D scene: who stood where, when, with what certainty; on disk and in memory."""

from scene4d.store.query import Scene
from scene4d.store.site import Site

__all__ = ["Scene", "Site"]
