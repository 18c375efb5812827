"""The adapter against a torch of paper: the real one takes gigabytes and fetches its weights."""

import sys
from contextlib import nullcontext
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from scene4d.core.errors import UnavailableError
from scene4d.perception.detectors import make_detector
from scene4d.perception.detectors._maskrcnn import MaskRcnnDetector

FILE = "maskrcnn_resnet50_fpn_coco-0.pth"
NAMES = ["__background__", "person", "bicycle", "car"]


class Tensor:
    """As much of a tensor as is asked for."""

    def __init__(self, array):
        self.array = np.asarray(array)

    def float(self):
        return Tensor(self.array.astype(np.float32))

    def __truediv__(self, value):
        return Tensor(self.array / value)

    def detach(self):
        return self

    cpu = detach

    def numpy(self):
        return self.array


class Model:
    """Answers with what it is told, and remembers what it was shown."""

    def __init__(self):
        self.shown, self.threads, self.state = [], [], None
        self.answer = {
            "boxes": np.array([[-3.0, 1, 9, 12], [2, 2, 6, 8], [1, 1, 3, 3]], np.float32),
            "scores": np.array([0.6, 0.9, 0.2], np.float32),
            "labels": np.array([3, 1, 1]),
            "masks": np.zeros((3, 1, 10, 8), np.float32),
        }
        self.answer["masks"][1, 0, 2:8, 2:6] = 0.7

    def load_state_dict(self, state):
        self.state = state

    def eval(self):
        return self

    def __call__(self, pictures):
        self.shown += [p.array for p in pictures]
        self.threads.append(sys.modules["torch"].get_num_threads())
        return [{name: Tensor(value) for name, value in self.answer.items()}]


@pytest.fixture
def libraries(monkeypatch, tmp_path):
    """torch and torchvision of paper, whose hub is not reachable."""
    count = [8]
    torch, vision = ModuleType("torch"), ModuleType("torchvision")
    torch.from_numpy = Tensor
    torch.inference_mode = nullcontext
    torch.get_num_threads = lambda: count[0]
    torch.set_num_threads = lambda n: count.__setitem__(0, n)
    torch.hub = SimpleNamespace(get_dir=lambda: str(tmp_path / "hub"))

    model = Model()

    published = SimpleNamespace(
        url=f"https://somewhere/{FILE}",
        meta={"categories": NAMES},
        get_state_dict=lambda progress, check_hash: {"backbone": 1},
    )
    detection = ModuleType("torchvision.models.detection")
    detection.MaskRCNN_ResNet50_FPN_Weights = SimpleNamespace(COCO_V1=published)
    detection.maskrcnn_resnet50_fpn = lambda weights, weights_backbone: model
    vision.models = SimpleNamespace(detection=detection)
    for module in (torch, vision, detection):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return SimpleNamespace(torch=torch, model=model, published=published)


def test_masks_and_names_come_with_the_boxes(libraries):
    detector = MaskRcnnDetector()
    image = np.zeros((10, 8, 3), np.uint8)
    image[0, 0] = 255, 128, 0
    found = detector.detect(image)
    assert found.data["class_name"].tolist() == ["person", "car"]
    assert found.confidence == pytest.approx([0.9, 0.6])
    # Counted from the first pixel's centre, and cut at the borders of 8 x 10 pixels.
    assert found.xyxy == pytest.approx(np.array([[1.5, 1.5, 5.5, 7.5], [-0.5, 0.5, 7.5, 9.5]]))
    assert found.mask.shape == (2, 10, 8)
    assert found.mask[0].sum() == 24
    assert not found.mask[1].any()
    (shown,) = libraries.model.shown
    assert shown.shape == (3, 10, 8)
    assert shown[:, 0, 0] == pytest.approx([0, 128 / 255, 1])


def test_threads_are_few_and_put_back(libraries):
    MaskRcnnDetector().detect(np.zeros((10, 8, 3), np.uint8))
    assert libraries.model.threads == [2]
    assert libraries.torch.get_num_threads() == 8


def test_an_empty_street(libraries):
    answer = libraries.model.answer
    for name, value in answer.items():
        answer[name] = value[:0]
    found = MaskRcnnDetector().detect(np.zeros((10, 8, 3), np.uint8))
    assert found.xyxy.shape == (0, 4)
    assert len(found) == 0


def test_weights_that_cannot_be_fetched_are_named_with_their_place(
    libraries, tmp_path, monkeypatch
):
    def unreachable(progress, check_hash):
        raise OSError("no route to host")

    make_detector("torchvision-maskrcnn")
    assert libraries.model.state == {"backbone": 1}
    monkeypatch.setattr(libraries.published, "get_state_dict", unreachable)
    with pytest.raises(UnavailableError) as caught:
        MaskRcnnDetector()
    place = tmp_path / "hub" / "checkpoints" / FILE
    for part in (FILE, str(place), "no route to host", "copy the file to", "weights"):
        assert part in str(caught.value)


@pytest.mark.parametrize("missing", ["torch", "torchvision"])
def test_a_missing_library_names_the_extra(libraries, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(UnavailableError, match=r"pip install scene4d\[torch\]"):
        make_detector("torchvision-maskrcnn")


def test_a_torchvision_for_another_torch_is_explained(libraries, monkeypatch, tmp_path):
    """What importing a CUDA torchvision beside a torch for the processor alone raises."""
    (tmp_path / "torchvision.py").write_text(
        "raise RuntimeError('operator torchvision::nms does not exist')"
    )
    monkeypatch.delitem(sys.modules, "torchvision")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UnavailableError) as caught:
        make_detector("torchvision-maskrcnn")
    for part in ("torchvision::nms", "do not fit", "pip uninstall torch torchvision", "[torch]"):
        assert part in str(caught.value)
