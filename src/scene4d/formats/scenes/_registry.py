"""All scene formats. A new one is a file beside this one and a line in :data:`_FORMATS`."""

import os
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.core.files import replace_files
from scene4d.core.text import in_file
from scene4d.formats._choosing import by_name
from scene4d.formats.scenes import _csv, _geojson, _kpf, _mot, _moving_features, _openlabel, _rerun
from scene4d.formats.scenes._contract import SceneFormat, SceneTable

_FORMATS: tuple[SceneFormat, ...] = (
    _csv.FORMAT,
    _mot.FORMAT,
    _kpf.FORMAT,
    _geojson.FORMAT,
    _moving_features.FORMAT,
    _openlabel.FORMAT,
    _rerun.FORMAT,
)


def scene_formats() -> tuple[SceneFormat, ...]:
    """Every format."""
    return _FORMATS


def write_scene(
    scene: SceneTable | Iterable[SceneTable],
    path: str | os.PathLike[str],
    format: str,  # noqa: A002 - the word that people look for
) -> tuple[Path, ...]:
    """Write a scene in a format of :func:`scene_formats`, atomically; the files that were written.

    ``scene`` may be pieces that follow one another in time, read one at a time: csv, mot, kpf,
    openlabel and rerun hold one in memory, geojson and moving-features all of them, since they
    write track by track. csv takes the pieces of any clips, the others those of one. ``path`` is
    the file; for kpf, ``NAME`` or ``NAME.geom.yml`` gives ``NAME.geom.yml`` and ``NAME.types.yml``.
    Existing files are replaced, a folder never is, and missing folders are made.

    Raises :class:`InputError` for an unknown format, a scene without rows and what the format
    cannot hold, :class:`~scene4d.core.errors.OutputError` where a file cannot be written, and
    :class:`~scene4d.core.errors.UnavailableError` where a geo-anchor is used without pyproj, or the
    Rerun SDK is not installed.
    Nothing is changed then.
    """
    path = Path(path)
    chosen = by_name(_FORMATS, format, "scene")
    paths = _paths(path, chosen)
    with in_file(path):
        pieces = _filled([scene] if isinstance(scene, SceneTable) else scene)
        replace_files(paths, chosen.write(pieces), parents=True)
    return tuple(paths.values())


def _paths(path: Path, chosen: SceneFormat) -> dict[str, Path]:
    if len(chosen.suffixes) == 1:
        return {chosen.suffixes[0]: path}
    name = path.name
    for suffix in chosen.suffixes:
        name = name.removesuffix(suffix)
    if not name:
        raise InputError(f"{path}: expected a name before {' and '.join(chosen.suffixes)}")
    return {suffix: path.with_name(name + suffix) for suffix in chosen.suffixes}


def _filled(pieces: Iterable[SceneTable]) -> Iterator[SceneTable]:
    """The pieces that hold rows. Raises :class:`InputError` where none does."""
    filled = (piece for piece in pieces if len(piece.tracks))
    first = next(filled, None)
    if first is None:
        raise InputError("the scene holds no rows; there is nothing to export")
    return chain([first], filled)
