"""What a search asks for: words, read against a scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.known import PREDICATES
from scene4d.searching.activities.terms import nearest, places_of
from scene4d.searching.clock import unknown_starts
from scene4d.searching.language import Query, parse_query
from scene4d.searching.places import Places, read_places
from scene4d.store.query import Scene


@dataclass(frozen=True, eq=False)
class Asked:
    """A search that can be made: the ``query`` as it was understood, the ``places`` that it names,
    and ``notes``: the query's own, and those on how it meets this scene.
    """

    query: Query
    places: Places
    notes: tuple[str, ...]


def understand(
    scene: Scene, words: str, *, catalogues: Sequence[Path] = (), zones: Path | None = None
) -> Asked:
    """Read the words; nothing of the scene but its manifests is looked at.

    ``catalogues`` are files of activities beside the built-in ones, ``zones`` a file of places.
    Raises :class:`InputError` for words, files and places that are not understood, for a role that
    nobody in the scene can play, and for a time of day where the footage's own is not known.
    """
    places = Places() if zones is None else read_places(zones, scene.cameras)
    query = parse_query(
        words,
        load_catalogue(*catalogues),
        zones=places.names("zone"),
        lines=places.names("line"),
    )
    _check_roles(scene, query)
    used = _check_places(query, places)
    notes = [*query.notes]
    shared = [name for name in places.shared if name in used]
    if shared and len(scene.cameras) > 1:
        notes.append(
            f"{', '.join(map(repr, shared))}: taken in the metres of each of {len(scene.cameras)} "
            "cameras, since the file names none for it"
        )
    if query.window is not None:
        notes += _check_window(scene, query)
    named = Places(tuple(place for place in places.all if place.name in used))
    return Asked(query, named, tuple(notes))


def _check_roles(scene: Scene, query: Query) -> None:
    there = scene.classes
    for role in query.activity.roles:
        if not set(role.classes) & set(there):
            rows = ", ".join(f"{name} ({count:,} rows)" for name, count in there.items())
            raise InputError(
                f"the scene has no {' or '.join(role.classes)}: nobody can be the {role.name!r} of "
                f"{query.text!r}; there: {rows}"
            )


def _check_places(query: Query, places: Places) -> set[str]:
    """The names of the places that are asked for."""
    terms = [term for phase in query.activity.phases for term in phase.terms]
    used: set[str] = set()
    for kind in ("zone", "line"):
        for name in places_of(terms, kind, PREDICATES):
            there = places.names(kind)
            if name not in there:
                raise InputError(
                    f"{query.text!r} asks for the {kind} {name!r}{nearest(name, there)}; name "
                    "places in a file and give it as --zones FILE"
                )
            used.add(name)
    return used


def _check_window(scene: Scene, query: Query) -> list[str]:
    """Notes on the time of day. Raises where it is known of no run."""
    unknown = unknown_starts(scene)
    runs = [run for run in scene.runs if run.rows]
    if len(unknown) == len(runs):
        raise InputError(
            f"{query.text!r} asks for a time of day, but when the footage began is not known: "
            "track it again with --start, as 2026-11-20T08:00:00Z"
        )
    notes = ["times of day are UTC; an event belongs to the time at which it begins"]
    if unknown:
        notes.append(
            f"{len(unknown)} of {len(runs)} clips are left out: when they began is not known"
        )
    return notes
