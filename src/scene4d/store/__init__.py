"""The 4-D scene: who stood where, when, with what certainty; on disk and in memory."""

from scene4d.store.query import Scene

__all__ = ["Scene"]
