"""What a server does in a process of its own: values of JSON in and out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from scene4d.core.progress import Progress


def search(
    folders: list[str], words: str, options: dict[str, Any], progress: Progress
) -> list[dict[str, Any]]:
    """Searches as words ask for them, as a page shows them."""
    from scene4d.app._contents import search_of

    return [search_of(one) for one in _searched(folders, words, options, progress)]


def export(
    folders: list[str], words: str, form: str, options: dict[str, Any], progress: Progress
) -> str:
    """All events of such searches as a file of ``scene4d search``."""
    from scene4d.searching.exporting import exported

    return exported(_searched(folders, words, options, progress), form)


def _searched(
    folders: list[str], words: str, options: dict[str, Any], progress: Progress
) -> list[Any]:
    from scene4d.searching import SearchOptions, answer, opened, understand_all

    asked = understand_all(opened(*map(Path, folders)), words, SearchOptions(**options))
    return [answer(one, progress) for one in asked]


TASKS: dict[str, Callable[..., Any]] = {"search": search, "export": export}
"""By name; each takes its values by name, and ``progress``."""
