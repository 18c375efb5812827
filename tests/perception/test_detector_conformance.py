"""The suite is right when good detectors pass and every bad one is told what it does wrong."""

from itertools import count

import cv2
import numpy as np
import pytest
import supervision as sv

from scene4d.perception.detectors.base import require_bgr
from scene4d.perception.detectors.conformance import check_detector

PERSON = np.full((60, 80, 3), 40, np.uint8)
PERSON[10:50, 30:45] = 255, 254, 253


def bright(image_bgr):
    """The box of what is white."""
    v, u = np.nonzero(image_bgr.min(axis=2) > 250)
    if not len(u):
        return sv.Detections.empty()
    return sv.Detections(
        xyxy=np.array([[u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5]]),
        confidence=np.array([0.9]),
        data={"class_name": np.array(["person"])},
    )


class Good:
    def detect(self, image_bgr):
        require_bgr(image_bgr)
        return self.change(bright(image_bgr), image_bgr)

    def change(self, found, image):
        return found


def bad(change):
    """A detector that is good but for this; it answers only where there is something to change."""

    class Bad(Good):
        def change(self, found, image):
            return change(found, image) if len(found) else found

    return Bad()


def with_boxes(offset, factor=1.0):
    def change(found, image):
        found.xyxy = found.xyxy * factor + np.asarray(offset)
        return found

    return bad(change)


def with_value(name, value):
    def change(found, image):
        setattr(found, name, value)
        return found

    return bad(change)


def with_names(names):
    def change(found, image):
        found.data["class_name"] = names
        return found

    return bad(change)


def refusing(seen):
    def change(found, image):
        if seen(image):
            raise ValueError("I do not like this")
        return found

    return bad(change)


class TinyRaises(Good):
    def detect(self, image_bgr):
        if image_bgr.size < 10:
            raise cv2.error("!ssize.empty()")
        return super().detect(image_bgr)


class Painter(Good):
    def detect(self, image_bgr):
        found = super().detect(image_bgr)
        if image_bgr.flags.writeable:
            image_bgr[0, 0] = 7
        return found


class Dreamer(Good):
    """Another answer every time."""

    def __init__(self):
        self.calls = count()

    def change(self, found, image):
        found.xyxy = found.xyxy - next(self.calls) / 100
        return found


class Loose(Good):
    """Takes whatever has rows and columns."""

    def detect(self, image_bgr):
        return bright(image_bgr if image_bgr.ndim == 3 else np.zeros((4, 4, 3)))


class Lister(Good):
    def change(self, found, image):
        return list(found.xyxy)


def nudged_views(found, image):
    if not image.flags.c_contiguous:
        found.xyxy = found.xyxy + 0.01
    return found


BAD = {
    "no method detect": object(),
    "one pixel: raised error: ": TinyRaises(),
    "returned list, expected sv.Detections": Lister(),
    "the picture was written into": Painter(),
    "read-only: raised ValueError: I do not like this": refusing(lambda i: not i.flags.writeable),
    "boxes have shape (1, 5)": with_value("xyxy", np.zeros((1, 5))),
    "a box is not finite": with_boxes([np.nan, 0, 0, 0]),
    "not ordered": with_boxes([0, 0, -60, 0]),
    "outside the image of 80x60": with_boxes([0, 0, 60, 0]),
    "boxes have no confidence": with_value("confidence", None),
    "confidence has shape (2,)": with_value("confidence", np.ones(2)),
    "a confidence is not in [0, 1]": with_value("confidence", np.array([97.0])),
    "is not in [0, 1]": with_value("confidence", np.array([np.nan])),
    "class_name has 2 entries for 1 boxes": with_names(np.array(["person", "car"])),
    "a class_name is not a text": with_names(np.array([1])),
    "masks are (1, 4, 4)": with_value("mask", np.zeros((1, 4, 4), bool)),
    "asked again, the answer is another one": Dreamer(),
    "a view into a larger array, the answer is another one": bad(nudged_views),
    "mirror image, the answer is another one": bad(nudged_views),
    "as floats 0-1, it neither refuses": Loose(),
    "in grey (h, w), it neither refuses": Loose(),
    "not even the person": bad(lambda found, image: sv.Detections.empty()),
}


def test_a_good_detector_passes():
    assert check_detector(Good(), PERSON) == []
    assert check_detector(Good()) == []


@pytest.mark.parametrize("complaint", BAD)
def test_every_fault_is_named(complaint):
    said = check_detector(BAD[complaint], PERSON)
    assert any(complaint in sentence for sentence in said), said
    assert len(said) == len(set(said))


def test_detectors_without_classes_and_with_masks_are_good():
    mask = np.zeros((1, 60, 80), bool)
    assert check_detector(with_value("mask", mask), PERSON) == []
    assert check_detector(with_value("data", {}), PERSON) == []


def test_a_fault_is_not_blamed_for_another():
    assert all("finite" in s for s in check_detector(with_boxes([np.nan] * 4), PERSON)[:1])
    said = check_detector(with_value("confidence", np.array([97.0])), PERSON)
    assert said == ["picture with a person: a confidence is not in [0, 1]"]


@pytest.mark.weights
@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["detector", "vehicle_detector"])
def test_ours_conform(name, pets_frames, request):
    assert check_detector(request.getfixturevalue(name), pets_frames[0].image_bgr) == []
