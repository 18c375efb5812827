"""Where the footage of a run is."""

from dataclasses import dataclass
from pathlib import Path, PurePath

from scene4d.store.runs import Run

_ANNOTATIONS = (".geom.yml", ".types.yml", ".yml", ".yaml", ".xml", ".txt", ".json", ".csv")
_REMEDY = "Pass footage: the file, or the folder, where it is now."


@dataclass(frozen=True)
class NoFootage:
    """Why there are no pictures and where they can come from, in words for the page."""

    reason: str


def footage_of(run: Run, given: Path | None, *, alone: bool) -> Path | NoFootage:
    """The video that a run was made of, or of which its annotations were.

    ``given`` is a file or folder in which to look instead of where it was tracked. A folder is
    searched for a file of the same name, and of annotations for one whose name begins like theirs.
    A file is taken if its name fits, or if no other run was searched (``alone``).
    """
    footage, annotations = (run.provenance.get(key) for key in ("source", "annotations"))
    source = footage or annotations
    if alone and given is not None and given.is_file():
        return given
    if not isinstance(source, str):
        return NoFootage("The scene does not say what footage it was made of.")
    name = PurePath(source).name
    if given is not None:
        return _in(given, name, annotated=footage is None)
    if footage is None:
        return NoFootage(f"Only the annotations {name} were tracked. {_REMEDY}")
    if "://" in source:
        return NoFootage("A stream was tracked, which is not recorded.")
    path = Path(source)
    return path if path.exists() else NoFootage(f"The footage is no longer at {source}. {_REMEDY}")


def _in(given: Path, name: str, *, annotated: bool) -> Path | NoFootage:
    """The footage called ``name``, or beginning like that of these annotations."""
    ending = next((end for end in _ANNOTATIONS if name.endswith(end)), PurePath(name).suffix)
    stem = name.removesuffix(ending)
    if given.is_file():
        if given.name == name or given.stem.startswith(stem):
            return given
        return NoFootage(f"{given.name} is not the footage of this clip, {name}.")
    if not annotated and (given / name).exists():
        return given / name
    for path in sorted(given.iterdir()):
        if path.name.startswith(stem) and not path.name.endswith(_ANNOTATIONS):
            return path
    return NoFootage(f"{given} holds no footage named like {name}.")
