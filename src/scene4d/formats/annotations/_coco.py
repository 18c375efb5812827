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

import numpy as np

from scene4d.core.body import COCO17, HALPE26
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.json_object import JsonObject
from scene4d.core.people import Detections
from scene4d.core.text import quoted
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

_DIGITS = re.compile(r"(\d{1,7})\D*$")  # more digits are a date or a time
_SKELETONS = {17: COCO17, 26: HALPE26}
"""By the number of keypoints, where no category names them."""


def _sniff(path: Path, head: str) -> bool:
    start = head.lstrip()[:1]
    return start in ("{", "[") and any(
        f'"{key}"' in head for key in ("images", "annotations", "categories", "image_id")
    )


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    values = read_json(path)
    results = isinstance(values, list)
    document = JsonObject({"annotations": values} if results else values, str(path))
    where, entries = [], []
    for i, entry in enumerate(document.objects("annotations")):
        if not entry.value("iscrowd"):
            where.append(f"annotations[{i}]")
            entries.append(entry)
    listed = document.objects("categories") if "categories" in document else []
    categories = {category.integer("id"): category for category in listed}
    frames = None if results else _frames(document.objects("images"), image_size)
    names = _skeleton(entries, categories)
    uv, keypoint_score = _keypoints(entries, len(names), 1.0 if results else 0.5)
    found = Detections.from_boxes(
        image_size,
        np.array([_frame(entry, frames) for entry in entries], dtype=np.int64),
        np.array([_corners(entry.array("bbox", 4)) for entry in entries]).reshape(-1, 4),
        score=np.array([e.number("score") if "score" in e else 1.0 for e in entries]),
        track=np.array(
            [e.integer("track_id") if "track_id" in e else -1 for e in entries], dtype=np.int64
        ),
        class_name=np.array([_class_name(entry, categories) for entry in entries], dtype=str),
        keypoint_uv=uv,
        keypoint_score=keypoint_score,
        keypoint_names=names,
    )
    return Rows(found, where)


def _frames(images: Sequence[JsonObject], image_size: tuple[int, int]) -> dict[int, int]:
    """Frame of every image id."""
    ids = [image.integer("id") for image in images]
    if len(set(ids)) != len(ids):
        raise InputError("field 'images': two images have the same id")
    for i, image in enumerate(images):
        found = (image.value("width"), image.value("height"))
        if None not in found and found != image_size:
            raise InputError(
                f"images[{i}] is {quoted(found[0])}x{quoted(found[1])}, but the footage is "
                f"{image_size[0]}x{image_size[1]}; give the image size that was annotated"
            )
    stems = [Path(str(image.value("file_name"))).stem for image in images]
    numbers = [int(match[1]) for stem in stems if (match := _DIGITS.search(stem))]
    if len(numbers) == len(images) and len(set(numbers)) == len(numbers):
        return dict(zip(ids, numbers, strict=True))
    return {image: rank for rank, image in enumerate(sorted(ids))}


def _frame(entry: JsonObject, frames: Mapping[int, int] | None) -> int:
    image = entry.integer("image_id")
    if frames is not None and image not in frames:
        raise entry.error("image_id", "the id of one of the images")
    return image if frames is None else frames[image]


def _corners(box: np.ndarray) -> np.ndarray:
    return np.concatenate([box[:2], box[:2] + box[2:]])


def _class_name(entry: JsonObject, categories: Mapping[int, JsonObject]) -> str:
    number = entry.integer("category_id")
    if number in categories:
        return categories[number].text("name")
    if not categories and number == 1:  # COCO's own numbering, for lists of results
        return "person"
    raise entry.error("category_id", "the id of one of the categories")


def _skeleton(
    entries: Sequence[JsonObject], categories: Mapping[int, JsonObject]
) -> tuple[str, ...]:
    """Names of the keypoints of all annotations that have some; () where none has."""
    found: set[tuple[str, ...]] = set()
    for entry in entries:
        if not entry.value("keypoints"):
            continue
        count, rest = divmod(len(entry.array("keypoints", None)), 3)
        category = categories.get(entry.integer("category_id"))
        names = _SKELETONS.get(count, ())
        if category is not None and "keypoints" in category:
            names = category.texts("keypoints")
        if rest or len(names) != count:
            raise entry.error("keypoints", f"x, y, v of each of {len(names)} names")
        found.add(names)
    if len(found) > 1:
        raise InputError("the annotations have different skeletons; keep one per file")
    return found.pop() if found else ()


def _keypoints(
    entries: Sequence[JsonObject], count: int, score_of_v: float
) -> tuple[np.ndarray, np.ndarray]:
    uv, score = np.full((len(entries), count, 2), np.nan), np.zeros((len(entries), count))
    for i, entry in enumerate(entries):
        if entry.value("keypoints"):
            values = entry.array("keypoints", None).reshape(count, 3)
            score[i] = np.clip(score_of_v * values[:, 2], 0.0, 1.0)
            uv[i] = np.where(score[i, :, None] > 0, values[:, :2], np.nan)
    return uv, score


FORMAT = AnnotationFormat("coco", "COCO JSON, boxes and keypoints", _sniff, _read)
