"""Searches in words: a controlled English, read into activities."""

from scene4d.searching.language._lexicon import state_examples, ways_to_say
from scene4d.searching.language._query import Query, explain, parse_query
from scene4d.searching.predicates._when import Window

__all__ = ["Query", "Window", "explain", "parse_query", "state_examples", "ways_to_say"]
