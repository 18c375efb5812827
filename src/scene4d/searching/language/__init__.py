"""Searches in words: a controlled English, read into activities.

Needs the extra ``query``; raises :class:`UnavailableError` on import where a package is missing.
"""

from scene4d.core.errors import UnavailableError

try:
    from scene4d.searching.language.clock import Window
    from scene4d.searching.language.explanation import explain
    from scene4d.searching.language.query import Query, parse_query
except ModuleNotFoundError as error:
    if error.name not in ("lark", "lemminflect"):
        raise
    raise UnavailableError(
        f"searching in words needs {error.name}: python -m pip install 'scene4d[query]'"
    ) from error

__all__ = ["Query", "Window", "explain", "parse_query"]
