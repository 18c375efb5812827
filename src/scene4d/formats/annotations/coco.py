"""COCO JSON: a data set (``images``, ``annotations``, ``categories``), or a bare list of results.

The frame of an image is the last group of digits in its file name where every image has one and
they differ (``frame_0248.jpg`` → 248), else its rank by image id; in a bare list, which names no
files, it is ``image_id``. ``iscrowd`` regions are left out. Boxes are ``x, y, width, height`` and
are taken as written. Keypoints are ``x, y, v``: in a data set v is 0 (unknown, NaN here), 1 (seen
only by the annotator, score 0.5) or 2 (visible, score 1); in a list of results it is the score.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.body import COCO17, HALPE26
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import floats, read_text
from scene4d.formats.annotations.boxes import Rows
from scene4d.formats.annotations.contract import AnnotationFormat

_DIGITS = re.compile(r"(\d{1,15})\D*$")
_LARGEST = 2**53


def _sniff(path: Path, head: str) -> bool:
    start = head.lstrip()[:1]
    return start in ("{", "[") and any(
        f'"{key}"' in head for key in ("images", "annotations", "categories", "image_id")
    )


def _entries(values: Any, name: str) -> list[Mapping[str, Any]]:
    if not isinstance(values, list) or not all(isinstance(v, dict) for v in values):
        raise InputError(f"field {name!r}: expected a list of objects")
    return values


def _get(entry: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in entry:
        raise InputError(f"{where}: field {key!r} is missing")
    return entry[key]


def _integer(entry: Mapping[str, Any], key: str, where: str) -> int:
    value = _get(entry, key, where)
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > _LARGEST:
        raise InputError(f"{where}: field {key!r} must be a whole number, found {value!r}")
    return value


def _frames(images: Sequence[Mapping[str, Any]], image_size: tuple[int, int]) -> dict[int, int]:
    """Frame of every image id."""
    ids = []
    for i, image in enumerate(images):
        where = f"images[{i}]"
        ids.append(_integer(image, "id", where))
        found = (image.get("width"), image.get("height"))
        if None not in found and found != image_size:
            raise InputError(
                f"{where}: is {found[0]}x{found[1]}, but the footage is "
                f"{image_size[0]}x{image_size[1]}; give the image size that was annotated"
            )
    if len(set(ids)) != len(ids):
        raise InputError("field 'images': two images have the same id")
    stems = [Path(str(image.get("file_name", ""))).stem for image in images]
    digits = [match[1] for stem in stems if (match := _DIGITS.search(stem))]
    numbers = [int(text) for text in digits]
    if len(numbers) == len(images) and len(set(numbers)) == len(numbers):
        return dict(zip(ids, numbers, strict=True))
    return {image: rank for rank, image in enumerate(sorted(ids))}


def _skeleton(
    entries: Sequence[Mapping[str, Any]], categories: Mapping[int, Any]
) -> tuple[str, ...]:
    """Names of the keypoints of all annotations that have some; () where none has."""
    found: set[tuple[str, ...]] = set()
    for i, entry in enumerate(entries):
        values = entry.get("keypoints")
        if not values:
            continue
        where = f"annotations[{i}]"
        if not isinstance(values, list) or len(values) % 3:
            raise InputError(f"{where}: field 'keypoints' must hold x, y, v per keypoint")
        category = categories.get(entry.get("category_id", 0), {})
        known = {17: COCO17, 26: HALPE26}.get(len(values) // 3, ())
        listed = category.get("keypoints") or known
        if not isinstance(listed, list | tuple):
            raise InputError(f"categories: field 'keypoints' must list names, found {listed!r}")
        names = tuple(map(str, listed))
        if len(names) != len(values) // 3:
            raise InputError(f"{where}: {len(values) // 3} keypoints, but {len(names)} names")
        found.add(names)
    if len(found) > 1:
        raise InputError("the annotations have different skeletons; keep one per file")
    return found.pop() if found else ()


def _keypoints(
    entries: Sequence[Mapping[str, Any]], count: int, results: bool
) -> tuple[np.ndarray, np.ndarray]:
    uv, score = np.full((len(entries), count, 2), np.nan), np.zeros((len(entries), count))
    for i, entry in enumerate(entries):
        if not entry.get("keypoints"):
            continue
        values = floats(entry["keypoints"], f"annotations[{i}] 'keypoints'").reshape(count, 3)
        score[i] = np.clip(values[:, 2] if results else values[:, 2] / 2, 0.0, 1.0)
        uv[i] = np.where(score[i, :, None] > 0, values[:, :2], np.nan)
    return uv, score


def _document(text: str) -> tuple[dict[str, Any], bool]:
    """The data set's fields, and whether the file is a bare list of results."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}") from error
    if isinstance(values, list):
        return {"annotations": values}, True
    if not isinstance(values, dict) or "annotations" not in values or "images" not in values:
        raise InputError("expected an object with 'images' and 'annotations', or a list of results")
    return values, False


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    values, results = _document(read_text(path))
    everything = _entries(values["annotations"], "annotations")
    kept = [(i, entry) for i, entry in enumerate(everything) if not entry.get("iscrowd")]
    where = [f"annotations[{i}]" for i, _ in kept]
    entries = [entry for _, entry in kept]
    categories = {
        _integer(c, "id", f"categories[{i}]"): c
        for i, c in enumerate(_entries(values.get("categories", []), "categories"))
    }
    frames = _frames(_entries(values.get("images", []), "images"), image_size)
    frame, box, names = [], [], []
    for place, entry in zip(where, entries, strict=True):
        image = _integer(entry, "image_id", place)
        if not results and image not in frames:
            raise InputError(f"{place}: image_id {image} is not among the images")
        frame.append(image if results else frames[image])
        box.append(_box(_get(entry, "bbox", place), place))
        names.append(_class_name(entry, categories, place))
    skeleton = _skeleton(entries, categories)
    uv, keypoint_score = _keypoints(entries, len(skeleton), results)
    found = Detections.from_boxes(
        image_size,
        np.array(frame, dtype=np.int64),
        np.array(box, dtype=float).reshape(-1, 4),
        score=np.array([_number(e, "score", 1.0, w) for e, w in zip(entries, where, strict=True)]),
        track=np.array(
            [
                _integer(e, "track_id", w) if "track_id" in e else -1
                for e, w in zip(entries, where, strict=True)
            ],
            dtype=np.int64,
        ),
        class_name=np.array(names, dtype=str),
        keypoint_uv=uv,
        keypoint_score=keypoint_score,
        keypoint_names=skeleton,
    )
    return Rows(found, where.__getitem__)


def _box(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 4:
        raise InputError(f"{where}: field 'bbox' must be x, y, width, height, found {value!r}")
    x, y, w, h = floats(value, f"{where} 'bbox'").tolist()
    return [x, y, x + w, y + h]


def _number(entry: Mapping[str, Any], key: str, default: float, where: str) -> float:
    return float(floats([entry.get(key, default)], f"{where} {key!r}")[0])


def _class_name(entry: Mapping[str, Any], categories: Mapping[int, Any], where: str) -> str:
    number = _integer(entry, "category_id", where)
    if number in categories:
        return str(_get(categories[number], "name", f"category {number}"))
    if not categories and number == 1:  # COCO's own numbering, for lists of results
        return "person"
    raise InputError(f"{where}: category_id {number} is not among the categories")


FORMAT = AnnotationFormat(
    name="coco",
    description="COCO JSON, boxes and keypoints",
    patterns=("*.json",),
    sniff=_sniff,
    read=_read,
)
