"""COCO JSON: a data set (``images``, ``annotations``, ``categories``), or a bare list of results.

The frame of an image is the last group of digits in its file name where every image has one and
they differ (``frame_0248.jpg`` → 248), else its rank by image id; in a bare list, which names no
files, it is ``image_id``. ``iscrowd`` regions are left out. Boxes are ``x, y, width, height`` and
are taken as written. Keypoints are ``x, y, v``: in a data set v is 0 (unknown, NaN here), 1 (seen
only by the annotator, score 0.5) or 2 (visible, score 1); in a list of results it is the score.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.body import COCO17, HALPE26
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.people import Detections
from scene4d.core.text import floats, quoted
from scene4d.formats.annotations.contract import AnnotationFormat, Rows

_DIGITS = re.compile(r"(\d{1,7})\D*$")  # more digits are a date or a time
_LARGEST = 2**53
_SKELETONS = {17: COCO17, 26: HALPE26}
"""By the number of keypoints, where no category names them."""


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
    if type(value) is not int or abs(value) > _LARGEST:
        raise InputError(f"{where}: field {key!r} must be a whole number, found {quoted(value)}")
    return value


def _document(values: Any) -> tuple[dict[str, Any], bool]:
    """The data set's fields, and whether the file is a bare list of results."""
    if isinstance(values, list):
        return {"annotations": values}, True
    if not isinstance(values, dict) or "annotations" not in values or "images" not in values:
        raise InputError("expected an object with 'images' and 'annotations', or a list of results")
    return values, False


def _frames(images: Sequence[Mapping[str, Any]], image_size: tuple[int, int]) -> dict[int, int]:
    """Frame of every image id."""
    ids = []
    for i, image in enumerate(images):
        where = f"images[{i}]"
        ids.append(_integer(image, "id", where))
        found = (image.get("width"), image.get("height"))
        if None not in found and found != image_size:
            raise InputError(
                f"{where}: is {quoted(found[0])}x{quoted(found[1])}, but the footage is "
                f"{image_size[0]}x{image_size[1]}; give the image size that was annotated"
            )
    if len(set(ids)) != len(ids):
        raise InputError("field 'images': two images have the same id")
    stems = [Path(str(image.get("file_name", ""))).stem for image in images]
    numbers = [int(match[1]) for stem in stems if (match := _DIGITS.search(stem))]
    if len(numbers) == len(images) and len(set(numbers)) == len(numbers):
        return dict(zip(ids, numbers, strict=True))
    return {image: rank for rank, image in enumerate(sorted(ids))}


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    values, results = _document(read_json(path))
    everything = _entries(values["annotations"], "annotations")
    kept = [(f"annotations[{i}]", e) for i, e in enumerate(everything) if not e.get("iscrowd")]
    categories = {
        _integer(c, "id", f"categories[{i}]"): c
        for i, c in enumerate(_entries(values.get("categories", []), "categories"))
    }
    frames = None if results else _frames(_entries(values["images"], "images"), image_size)
    names = _skeleton(kept, categories)
    uv, keypoint_score = _keypoints(kept, len(names), 1.0 if results else 0.5)
    found = Detections.from_boxes(
        image_size,
        np.array([_frame(e, frames, at) for at, e in kept], dtype=np.int64),
        np.array([_box(_get(e, "bbox", at), at) for at, e in kept]).reshape(-1, 4),
        score=np.array([floats([e.get("score", 1)], f"{at} 'score'")[0] for at, e in kept]),
        track=np.array(
            [_integer(e, "track_id", at) if "track_id" in e else -1 for at, e in kept],
            dtype=np.int64,
        ),
        class_name=np.array([_class_name(e, categories, at) for at, e in kept], dtype=str),
        keypoint_uv=uv,
        keypoint_score=keypoint_score,
        keypoint_names=names,
    )
    return Rows(found, [at for at, _ in kept])


def _frame(entry: Mapping[str, Any], frames: Mapping[int, int] | None, where: str) -> int:
    image = _integer(entry, "image_id", where)
    if frames is not None and image not in frames:
        raise InputError(f"{where}: image_id {image} is not among the images")
    return image if frames is None else frames[image]


def _box(value: Any, where: str) -> np.ndarray:
    if not isinstance(value, list) or len(value) != 4:
        raise InputError(
            f"{where}: field 'bbox' must be x, y, width, height, found {quoted(value)}"
        )
    box = floats(value, f"{where} 'bbox'")
    return np.concatenate([box[:2], box[:2] + box[2:]])


def _class_name(entry: Mapping[str, Any], categories: Mapping[int, Any], where: str) -> str:
    number = _integer(entry, "category_id", where)
    if number in categories:
        return str(_get(categories[number], "name", f"category {number}"))
    if not categories and number == 1:  # COCO's own numbering, for lists of results
        return "person"
    raise InputError(f"{where}: category_id {number} is not among the categories")


def _skeleton(
    kept: Sequence[tuple[str, Mapping[str, Any]]], categories: Mapping[int, Any]
) -> tuple[str, ...]:
    """Names of the keypoints of all annotations that have some; () where none has."""
    found: set[tuple[str, ...]] = set()
    for where, entry in kept:
        values = entry.get("keypoints")
        if not values:
            continue
        if not isinstance(values, list) or len(values) % 3:
            raise InputError(f"{where}: field 'keypoints' must hold x, y, v per keypoint")
        count = len(values) // 3
        category = categories.get(_integer(entry, "category_id", where), {})
        listed = category.get("keypoints") or _SKELETONS.get(count, ())
        if not isinstance(listed, list | tuple):
            raise InputError(
                f"categories: field 'keypoints' must list names, found {quoted(listed)}"
            )
        if len(listed) != count:
            raise InputError(f"{where}: {count} keypoints, but {len(listed)} names")
        found.add(tuple(map(str, listed)))
    if len(found) > 1:
        raise InputError("the annotations have different skeletons; keep one per file")
    return found.pop() if found else ()


def _keypoints(
    kept: Sequence[tuple[str, Mapping[str, Any]]], count: int, score_of_v: float
) -> tuple[np.ndarray, np.ndarray]:
    uv, score = np.full((len(kept), count, 2), np.nan), np.zeros((len(kept), count))
    for i, (where, entry) in enumerate(kept):
        if entry.get("keypoints"):
            values = floats(entry["keypoints"], f"{where} 'keypoints'").reshape(count, 3)
            score[i] = np.clip(score_of_v * values[:, 2], 0.0, 1.0)
            uv[i] = np.where(score[i, :, None] > 0, values[:, :2], np.nan)
    return uv, score


FORMAT = AnnotationFormat("coco", "COCO JSON, boxes and keypoints", _sniff, _read)
