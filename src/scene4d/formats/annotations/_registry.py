"""All annotation formats. A new one is a file beside this one and a line in :data:`_FORMATS`."""

import os
import warnings
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import in_file
from scene4d.formats._choosing import by_name, detected
from scene4d.formats.annotations import _coco, _kitti, _kpf, _mot, _pets, _towncentre, _virat
from scene4d.formats.annotations._contract import AnnotationFormat, Rows, first_fault

# The first whose sniff agrees reads the file, so the specific stand before the general.
_FORMATS: tuple[AnnotationFormat, ...] = (
    _coco.FORMAT,
    _pets.FORMAT,
    _kpf.FORMAT,
    _towncentre.CSV,
    _towncentre.TOP,
    _virat.FORMAT,
    _kitti.FORMAT,
    _mot.FORMAT,
)
_MOST_INVALID = 0.25
"""Share of impossible boxes above which they are not left out but the file is refused. Chosen: a
tracker's output has some (2 of 541 in one of the data sets here), another image's size half."""


def annotation_formats() -> tuple[AnnotationFormat, ...]:
    """Every format, in the order in which a file is tried."""
    return _FORMATS


def read_annotations(
    path: str | os.PathLike[str],
    *,
    image_size: tuple[int, int],
    fps: float | None = None,
    format: str | None = None,  # noqa: A002 - the word that people look for
    classes: Collection[str] | None = None,
    drop_invalid: bool = False,
) -> Detections:
    """Boxes (and keypoints) of an annotation file of any known format.

    ``image_size`` (width, height) is that of the footage. Frames count from 0, whatever the file
    does; ``time_s`` is ``frame / fps``, or NaN where ``fps`` is not given; ``format`` names the
    format instead of detecting it; ``classes`` keeps only these class names. Raises
    :class:`InputError` naming the file and the line (the entry, in JSON) of what cannot be parsed,
    and of boxes that are not finite, empty, swapped or wholly outside the image, or in a frame
    that no recording has; with ``drop_invalid`` such boxes are left out with a warning that says
    how many. Boxes that the border cuts are kept.
    """
    path = Path(path)
    if fps is not None and not (np.isfinite(fps) and fps > 0):
        raise InputError(f"fps must be positive, found {fps}")
    with in_file(path):
        rows = _rows(path, image_size, format)
        good, fault = first_fault(rows)
        if fault is not None and not drop_invalid:
            raise InputError(f"{fault} (drop_invalid leaves such boxes out)")
        bad = len(good) - int(good.sum())
        if bad > _MOST_INVALID * len(good):
            raise InputError(
                f"{bad} of {len(good)} boxes are impossible, so this is not the annotation of this "
                f"footage; the first: {fault}"
            )
    found = rows.detections
    if fault is not None:
        count = f"{bad} of {len(good)}"
        warnings.warn(f"{path}: left out {count} boxes; the first: {fault}", stacklevel=2)
        found = found.select(good)
    if fps is not None:
        found = replace(found, time_s=found.frame / fps)
    return found if classes is None else found.select(np.isin(found.class_name, list(classes)))


def _rows(path: Path, image_size: tuple[int, int], name: str | None) -> Rows:
    if path.is_dir():
        raise InputError("is a folder; expected an annotation file")
    if name is not None:
        chosen = by_name(_FORMATS, name, "annotation")
    else:
        chosen = detected(_FORMATS, path, "annotation")
    with np.errstate(over="ignore"):  # what is not finite then is told by its row
        return chosen.read(path, image_size)
