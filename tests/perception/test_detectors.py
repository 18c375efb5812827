from importlib.metadata import EntryPoint

import numpy as np
import pytest
import supervision as sv

from scene4d.core.errors import InputError, UnavailableError
from scene4d.perception import detectors
from scene4d.perception.detectors._base import Detector


class Nobody:
    def detect(self, image_bgr):
        return sv.Detections.empty()


@pytest.fixture
def registered(monkeypatch):
    entries = []
    monkeypatch.setattr(detectors, "entry_points", lambda group: entries)
    return entries


def test_a_package_can_add_a_detector_but_not_replace_ours(registered):
    registered += [
        EntryPoint("nobody", f"{__name__}:Nobody", detectors.GROUP),
        EntryPoint("yolox", f"{__name__}:Nobody", detectors.GROUP),
    ]
    built_in = ("torchvision-maskrcnn", "yolov4-tiny", "yolox")
    assert detectors.detector_names() == ("nobody", *built_in)
    found = detectors.make_detector("nobody")
    assert isinstance(found, Detector)
    assert len(found.detect(np.zeros((4, 4, 3), np.uint8))) == 0
    assert detectors._registered()["yolox"].value.startswith("scene4d.")


class Placed(Nobody):
    def __init__(self, device="auto"):
        self.device = device


def test_a_detector_runs_on_the_device_asked_for_or_says_that_it_chooses_its_own(registered):
    for kind in (Nobody, Placed):
        name = kind.__name__.lower()
        registered.append(EntryPoint(name, f"{__name__}:{kind.__name__}", detectors.GROUP))
    assert detectors.make_detector("placed", "cpu").device == "cpu"
    assert isinstance(detectors.make_detector("nobody", "auto"), Nobody)
    with pytest.raises(InputError, match="device: detector 'nobody' chooses its own"):
        detectors.make_detector("nobody", "cpu")


def test_an_unknown_or_broken_detector_is_named(registered):
    with pytest.raises(InputError, match=r"found 'yolo', expected one of .*, yolox;"):
        detectors.make_detector("yolo")
    registered.append(EntryPoint("broken", "no_such_module:Thing", detectors.GROUP))
    with pytest.raises(UnavailableError, match=r"'broken'.*no_such_module"):
        detectors.make_detector("broken")
