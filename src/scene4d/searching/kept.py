"""Searches that lie in a scene: whoever watches its cameras looks for them too.

    SCENE/standing.json    {"schema": "scene4d/standing/1", "searches": ["two people meet"]}

Zones and lines that they name are those of ``SCENE/zones.json``. Both files may change at any time.
"""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.json_object import JsonObject
from scene4d.searching._asking import SearchOptions, check_calibrated, words_of
from scene4d.searching._places import Places
from scene4d.searching.activities.calibrated import DETECTED
from scene4d.searching.language import Query

STANDING, ZONES = "standing.json", "zones.json"
_SCHEMA = "scene4d/standing/1"
_MOST, LONGEST = 32, 400
"""Searches, each of which is made once a second, and characters of one."""


def kept_searches(scene: Path) -> tuple[str, ...]:
    """The words of those searches; none where there is no file.

    Raises :class:`InputError` for another structure, and for more or longer ones than are kept.
    """
    path = scene / STANDING
    if not path.is_file():
        return ()
    values = JsonObject.read(path, _SCHEMA)
    values.only(("schema", "searches"))
    found = values.value("searches")
    if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
        raise values.error("searches", "a list of texts")
    if len(found) > _MOST or any(not 0 < len(one) <= LONGEST for one in found):
        raise values.error("searches", f"at most {_MOST} texts of 1 to {LONGEST} characters")
    return tuple(dict.fromkeys(found))


def keep_search(scene: Path, words: str, cameras: Collection[str]) -> None:
    """Add a search. Raises :class:`InputError` for words that are not understood there."""
    standing_query(words, kept_options(scene, SearchOptions()), cameras)
    kept = kept_searches(scene)
    if len(kept) >= _MOST and words not in kept:
        raise InputError(f"{_MOST} searches stand in {scene.name} already; remove one")
    _write(scene, (*kept, words))


def drop_search(scene: Path, words: str) -> None:
    """Remove a search, if it is there."""
    _write(scene, tuple(one for one in kept_searches(scene) if one != words))


def _write(scene: Path, searches: tuple[str, ...]) -> None:
    write_json(scene / STANDING, {"schema": _SCHEMA, "searches": list(dict.fromkeys(searches))})


def kept_options(scene: Path, options: SearchOptions) -> SearchOptions:
    """The same options with the scene's own zones and lines."""
    zones = scene / ZONES
    return replace(options, zones=zones if zones.is_file() else None)


def standing_query(
    words: str, options: SearchOptions, cameras: Collection[str] | None
) -> tuple[Query, Places]:
    """Words and the places that they name, as a search that stands has them.

    Raises :class:`InputError` for what is not understood, or needs a memory of other times.
    """
    query, places = words_of(words, options, cameras)
    if options.min_probability is not None:
        check_calibrated(query, (DETECTED,))
    if query.activity.spots:
        raise InputError(
            f"{query.text!r}: where another one was is not remembered while watching; "
            "search the scene for it"
        )
    if any(one.is_of_nobody for one in query.activity.options):
        raise InputError(
            f"{query.text!r}: that nobody is there is not told while watching; "
            "search the scene for it"
        )
    return query, places
