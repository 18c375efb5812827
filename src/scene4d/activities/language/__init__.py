"""Searches in words: a controlled English, read into activities."""

from scene4d.activities.language.clock import Window
from scene4d.activities.language.explanation import explain
from scene4d.activities.language.query import Query, parse_query

__all__ = ["Query", "Window", "explain", "parse_query"]
