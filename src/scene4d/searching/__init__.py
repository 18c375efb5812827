"""``scene4d search``: words in, ranked events out."""

from scene4d.searching.asking import Asked, understand
from scene4d.searching.finding import FoundEvent, Search, search

__all__ = ["Asked", "FoundEvent", "Search", "search", "understand"]
