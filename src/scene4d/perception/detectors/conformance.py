"""What a detector owes to those who use it, checked: for people who bring their own.

``violations = check_detector(detector, person_bgr)`` in a test of yours; an empty list is good.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import supervision as sv
from jaxtyping import UInt8

_EDGE_PX = 0.5
"""How far a box may reach outside: detectors that count pixels from their edges are let pass."""

_Case = tuple[str, np.ndarray]
_NOISE = "noise 160x120"


def check_detector(
    detector: Any, person_bgr: UInt8[np.ndarray, "h w 3"] | None = None
) -> list[str]:
    """What the detector does wrong, one sentence each; empty where it keeps to the protocol.

    It is shown black, grey, noisy, tiny and narrow pictures, and ``person_bgr`` (a picture with a
    person in it, in which it must find something; without it the boxes may never be looked at).
    Checked: what comes back is ``sv.Detections`` with boxes that are finite, ordered and inside
    the image, a confidence each in [0, 1], class names that are strings, masks of the image's
    size; the same picture gives the same answer, also as a copy, as a view into a larger array
    and read-only; the picture is not written into; float and grey arrays are refused, or give the
    answer of the same picture in bytes.
    """
    if not callable(getattr(detector, "detect", None)):
        return ["it has no method detect(image_bgr)"]
    said: list[str] = []
    for what, image in _pictures(person_bgr):
        answer = _ask(detector, image.copy(), what, said)
        if answer is None:
            continue
        said += [f"{what}: {wrong}" for wrong in _wrong_in(answer, image)]
        if what == _NOISE or image is person_bgr:  # where there may be something to change
            said += _unlike(detector, image, what, answer)
        if image is person_bgr:
            if not len(answer):
                said.append(f"{what}: nothing was found, not even the person")
            said += _other_types(detector, image, what, answer)
    return list(dict.fromkeys(said))


def _pictures(person_bgr: np.ndarray | None) -> Iterator[_Case]:
    rng = np.random.default_rng(0)
    yield "black picture 64x48", np.zeros((48, 64, 3), np.uint8)
    yield "grey picture 200x150", np.full((150, 200, 3), 128, np.uint8)
    yield _NOISE, rng.integers(0, 256, (120, 160, 3), np.uint8)
    yield "one pixel", np.full((1, 1, 3), 200, np.uint8)
    yield "narrow picture 3x240", np.full((240, 3, 3), 90, np.uint8)
    if person_bgr is not None:
        yield "picture with a person", person_bgr


def _ask(detector: Any, image: np.ndarray, what: str, said: list[str]) -> sv.Detections | None:
    before = image.copy()
    try:
        answer = detector.detect(image)
    except Exception as error:
        said.append(f"{what}: raised {type(error).__name__}: {error}")
        return None
    if image.shape != before.shape or not np.array_equal(image, before):
        said.append(f"{what}: the picture was written into")
    if not isinstance(answer, sv.Detections):
        said.append(f"{what}: returned {type(answer).__name__}, expected sv.Detections")
        return None
    return answer


def _wrong_in(answer: sv.Detections, image: np.ndarray) -> Iterator[str]:
    box, n = np.asarray(answer.xyxy), len(answer)
    height, width = image.shape[:2]
    if box.shape != (n, 4):
        yield f"boxes have shape {box.shape}, expected ({n}, 4)"
    elif not np.isfinite(box).all():
        yield "a box is not finite"
    else:
        if not (box[:, 2:] > box[:, :2]).all():
            yield "a box is empty or its corners are not ordered x1 < x2, y1 < y2"
        low, high = -0.5 - _EDGE_PX, np.array([width, height] * 2) - 0.5 + _EDGE_PX
        if (box < low - 1e-6).any() or (box > high + 1e-6).any():
            yield f"a box reaches outside the image of {width}x{height}"
    score = answer.confidence
    if score is None:
        if n:
            yield "boxes have no confidence"
    elif np.shape(score) != (n,):
        yield f"confidence has shape {np.shape(score)}, expected ({n},)"
    elif not ((np.asarray(score) >= 0) & (np.asarray(score) <= 1)).all():
        yield "a confidence is not in [0, 1]"
    names = answer.data.get("class_name")
    if names is not None:
        if len(names) != n:
            yield f"class_name has {len(names)} entries for {n} boxes"
        elif not all(isinstance(name, str) and name for name in names):
            yield "a class_name is not a text, or empty"
    if answer.mask is not None and (
        np.shape(answer.mask) != (n, height, width) or np.asarray(answer.mask).dtype != np.bool_
    ):
        yield f"masks are {np.shape(answer.mask)}, expected booleans ({n}, {height}, {width})"


def _unlike(detector: Any, image: np.ndarray, what: str, answer: sv.Detections) -> list[str]:
    """Ways to show the same picture that change the answer."""
    said: list[str] = []
    height, width = image.shape[:2]
    framed = np.zeros((height + 2, width + 4, 3), np.uint8)
    framed[1:-1, 2:-2] = image
    locked = image.copy()
    locked.flags.writeable = False
    ways = {
        "asked again": image.copy(),
        "as a view into a larger array": framed[1:-1, 2:-2],
        "as a mirrored view of its mirror image": np.ascontiguousarray(image[:, ::-1])[:, ::-1],
        "read-only": locked,
    }
    for way, picture in ways.items():
        other = _ask(detector, picture, f"{what}, {way}", said)
        if other is not None and not _same(answer, other):
            said.append(f"{what}: {way}, the answer is another one")
    return said


def _other_types(detector: Any, image: np.ndarray, what: str, answer: sv.Detections) -> list[str]:
    """Arrays that are no (h, w, 3) of bytes: an error is right, another answer is not."""
    said: list[str] = []
    luma = image.mean(axis=2).astype(np.uint8)
    grey = _ask(detector, np.stack([luma] * 3, axis=2), f"{what}, in grey", said)
    cases: list[tuple[str, np.ndarray, sv.Detections | None]] = [
        ("as floats 0-255", image.astype(np.float32), answer),
        ("as floats 0-1", image.astype(np.float32) / 255, answer),
        ("in grey (h, w)", luma, grey),
    ]
    for way, picture, expected in cases:
        try:
            other = detector.detect(picture)
        except Exception:  # any refusal will do
            continue
        same = isinstance(other, sv.Detections) and expected is not None and _same(expected, other)
        if not same:
            said.append(f"{what}: {way}, it neither refuses nor answers as for the same in bytes")
    return said


def _same(a: sv.Detections, b: sv.Detections) -> bool:
    def equal(x: Any, y: Any) -> bool:
        return (x is None) == (y is None) and (x is None or np.array_equal(x, y))

    names = (d.data.get("class_name") for d in (a, b))
    return (
        equal(a.xyxy, b.xyxy)
        and equal(a.confidence, b.confidence)
        and equal(a.class_id, b.class_id)
        and equal(a.mask, b.mask)
        and equal(*names)
    )
