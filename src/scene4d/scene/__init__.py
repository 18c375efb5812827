"""The 4-D scene: who stood where, when, with what certainty; on disk and in memory."""
