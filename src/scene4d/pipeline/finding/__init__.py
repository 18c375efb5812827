"""``scene4d search``: words in, ranked events out."""

from scene4d.pipeline.finding.asking import Asked, understand
from scene4d.pipeline.finding.searching import FoundEvent, Search, search

__all__ = ["Asked", "FoundEvent", "Search", "search", "understand"]
