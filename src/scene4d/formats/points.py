"""Points on the ground in pixels, from whatever file somebody has them in.

Two columns ``u v`` as text or CSV (a header line ``u,v`` may stand first), ``people.parquet`` as
``scene4d calibrate`` writes it (the feet of its inliers), or an annotation file of any known
format (the bottom centres of person boxes).
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError
from scene4d.core.tables import read_table
from scene4d.core.text import head_text, in_file, quoted, read_text
from scene4d.formats._choosing import names, recognised
from scene4d.formats._numbers import all_numbers, numeric_table
from scene4d.formats.annotations import annotation_formats, read_annotations

_SEPARATORS = re.compile(r"\s*[,;]\s*|\s+")
_NEEDED = ("foot_u", "foot_v", "inlier")


def read_points(
    path: str | os.PathLike[str], *, image_size: tuple[int, int]
) -> Float[np.ndarray, "n 2"]:
    """Ground points (n, 2) in pixels of footage of this size, n at least 1.

    Feet of annotated boxes that lie outside the image are left out, since boxes may be cut by its
    border. Points that were given as such must lie inside: :class:`InputError` names the file and
    the row of the first that does not, as it does for what is no number, and for files that are
    none of the three.
    """
    path = Path(path)
    with in_file(path):
        head = head_text(path)
        if path.suffix.lower() == ".parquet" or head.startswith("PAR1"):
            return _inlier_feet(path, image_size)
        if _has_two_columns(head):
            return _listed(path, image_size)
        if recognised(annotation_formats(), path, head) is None:
            raise InputError(
                "holds no ground points; expected two columns u v (a header u,v may stand first), "
                "the people.parquet of a calibration, or annotated boxes of a known format "
                f"({names(annotation_formats())})"
            )
        return _annotated_feet(path, image_size)


def _first_row(text: str) -> tuple[int, list[str]]:
    """Index and words of the first line that is neither blank nor a comment."""
    for index, line in enumerate(text.splitlines()):
        row = line.partition("#")[0].strip()
        if row:
            return index, _SEPARATORS.split(row)
    return 0, []


def _is_header(words: list[str]) -> bool:
    return [word.strip("\"'").lower() for word in words] == ["u", "v"]


def _has_two_columns(head: str) -> bool:
    _, words = _first_row(head)
    return len(words) == 2 and (_is_header(words) or any(all_numbers([word]) for word in words))


def _listed(path: Path, image_size: tuple[int, int]) -> Float[np.ndarray, "n 2"]:
    text = read_text(path)
    index, words = _first_row(text)
    if _is_header(words):
        lines = text.splitlines()
        lines[index] = ""  # a blank line keeps the numbers of the others
        text = "\n".join(lines)
    table, where = numeric_table(text, 2)
    if table.shape[1] != 2:
        raise InputError(f"{where[0]}: expected 2 columns u v, found {table.shape[1]}")
    return _checked(table, where.__getitem__, image_size)


def _inlier_feet(path: Path, image_size: tuple[int, int]) -> Float[np.ndarray, "n 2"]:
    table = read_table(path)
    missing = [name for name in _NEEDED if name not in table]
    if missing:
        raise InputError(
            f"column {missing[0]!r} is missing; expected {', '.join(_NEEDED)} as in the "
            f"people.parquet of a calibration, found {quoted(', '.join(table))}"
        )
    for name, kinds in zip(_NEEDED, ("fiu", "fiu", "b"), strict=True):
        if table[name].dtype.kind not in kinds:
            wanted = "true or false" if kinds == "b" else "numbers"
            raise InputError(f"column {name!r}: expected {wanted}, found {table[name].dtype}")
    rows = np.flatnonzero(table["inlier"])
    if not len(rows):
        raise InputError("none of its people is an inlier, so none is known to stand on the ground")
    uv = np.column_stack([table["foot_u"], table["foot_v"]])[rows].astype(float)
    return _checked(uv, lambda row: f"row {rows[row] + 1}", image_size)


def _annotated_feet(path: Path, image_size: tuple[int, int]) -> Float[np.ndarray, "n 2"]:
    people = read_annotations(path, image_size=image_size, classes=["person"])
    feet = people.box_foot_uv[_inside(people.box_foot_uv, image_size)]
    if not len(feet):
        raise InputError("holds no box of a person whose feet are in the picture")
    return feet


def _inside(uv: Float[np.ndarray, "n 2"], image_size: tuple[int, int]) -> Bool[np.ndarray, "n"]:
    """Pixel centres lie at integers: the image reaches from -0.5 to width - 0.5."""
    return np.all((uv >= -0.5) & (uv <= np.array(image_size) - 0.5), axis=1)


def _checked(
    uv: Float[np.ndarray, "n 2"], where: Callable[[int], str], image_size: tuple[int, int]
) -> Float[np.ndarray, "n 2"]:
    good = _inside(uv, image_size)  # NaN is inside nothing
    if not good.all():
        first = int(np.argmin(good))
        u, v = uv[first]
        raise InputError(
            f"{where(first)}: point ({u:g}, {v:g}) does not lie in the "
            f"{image_size[0]}x{image_size[1]} image; expected pixels of the footage"
        )
    return uv
