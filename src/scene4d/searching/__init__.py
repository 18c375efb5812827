"""``scene4d search``: words in, ranked events out."""

from scene4d.searching._asking import Asked, SearchOptions, understand, understand_all, words_of
from scene4d.searching._entry import answer, opened, search
from scene4d.searching._places import Place, Places, read_places
from scene4d.searching.result import FoundEvent, SearchResult

__all__ = [
    "Asked",
    "FoundEvent",
    "Place",
    "Places",
    "SearchOptions",
    "SearchResult",
    "answer",
    "opened",
    "read_places",
    "search",
    "understand",
    "understand_all",
    "words_of",
]
