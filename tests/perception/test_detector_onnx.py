"""YOLOX layouts in networks of a few bytes, whose output is written into them."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from scene4d.core.errors import InputError
from scene4d.perception.detectors._base import require_bgr
from scene4d.perception.detectors.yolox import OnnxYoloxDetector

SIDE = 64
CELLS = 8 * 8 + 4 * 4 + 2 * 2
NAMES = ("person", "car")


def network(path: Path, outputs: dict, *, nodes=(), shape=(1, 3, SIDE, SIDE), kind=None) -> Path:
    """An ONNX file with these constants as outputs, or with ``nodes`` that make them."""
    made = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))
        for name, value in outputs.items()
        if isinstance(value, np.ndarray)
    ]
    ends = [
        helper.make_tensor_value_info(
            name, TensorProto.INT64 if name == "labels" else TensorProto.FLOAT, None
        )
        for name in outputs
    ]
    begin = helper.make_tensor_value_info("picture", kind or TensorProto.FLOAT, shape)
    graph = helper.make_graph([*made, *nodes], "tiny", [begin], ends)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, path)
    return path


def openmmlab(*rows, labels=None):
    """Outputs with the suppression inside."""
    dets = np.array([rows], np.float32).reshape(1, -1, 5)
    labels = [0] * dets.shape[1] if labels is None else labels
    return {"dets": dets, "labels": np.array([labels], np.int64)}


def head(*rows, classes=2):
    """The head's own output: (cell, u, v, log w, log h, objectness, classes...)."""
    out = np.zeros((1, CELLS, 5 + classes), np.float32)
    for cell, *values in rows:
        out[0, cell] = values
    return {"output": out}


def detector(path: Path, **options) -> OnnxYoloxDetector:
    """Without tiles, which so small an input would want for every picture."""
    made = OnnxYoloxDetector(path, class_names=NAMES, **options)
    return made.expecting(lambda rows: np.full(len(rows), 1000.0))


PICTURE = np.zeros((100, 200, 3), np.uint8)
"""Shrunk by 0.32 into the upper half of the input."""


def test_boxes_after_suppression_are_mapped_to_the_picture(tmp_path):
    path = network(
        tmp_path / "net.onnx",
        openmmlab([16, 8, 32, 24, 0.9], [0, 0, 8, 8, 0.3], [32, 0, 70, 40, 0.5], labels=[1, 0, 0]),
    )
    found = detector(path).detect(PICTURE)
    assert found.data["class_name"].tolist() == ["car", "person"]
    assert found.confidence == pytest.approx([0.9, 0.5])
    # 16 / 0.32 = 50 px from the left edge; the second box ends at the picture's borders.
    assert found.xyxy == pytest.approx(
        np.array([[49.5, 24.5, 99.5, 74.5], [99.5, -0.5, 199.5, 99.5]])
    )


def test_the_head_itself_is_decoded_on_its_grids(tmp_path):
    ln = np.log
    path = network(
        tmp_path / "net.onnx",
        head(
            # Stride 8, column 3, row 2: centre (3.5, 2.25) * 8 = (28, 18), size 16 x 8.
            (2 * 8 + 3, 0.5, 0.25, ln(2), ln(1), 0.9, 0.1, 0.8),
            # Stride 16, column 2, row 1: centre (2, 1) * 16 = (32, 16), size 16 x 32.
            (64 + 1 * 4 + 2, 0.0, 0.0, ln(1), ln(2), 1.0, 0.95, 0.0),
            # Stride 32, column 1, row 0: too weak, 0.5 * 0.5.
            (64 + 16 + 1, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5),
        ),
    )
    found = detector(path).detect(PICTURE)
    assert found.data["class_name"].tolist() == ["person", "car"]
    assert found.confidence == pytest.approx([0.95, 0.72])
    first, second = np.array([24, 0, 40, 32]), np.array([20, 14, 36, 22])
    assert found.xyxy == pytest.approx(np.array([first, second]) / 0.32 - 0.5, abs=1e-4)


def test_a_head_that_was_decoded_in_the_export_is_taken_as_it_is(tmp_path):
    centre = []
    for stride in (8, 16, 32):
        for v in range(SIDE // stride):
            centre += [((u + 0.5) * stride, (v + 0.5) * stride) for u in range(SIDE // stride)]
    output = head((0, 28, 18, 16, 8, 0.9, 0, 1.0))
    output["output"][0, 1:, :2] = centre[1:]
    found = detector(network(tmp_path / "net.onnx", output)).detect(PICTURE)
    assert found.xyxy == pytest.approx(np.array([[20, 14, 36, 22]]) / 0.32 - 0.5)


def test_duplicates_go_within_a_class_and_stay_between_classes(tmp_path):
    rows = ([10, 5, 30, 25, 0.9], [11, 5, 31, 25, 0.8], [10, 6, 30, 25, 0.7])
    for labels, left in (([0, 0, 0], 1), ([0, 1, 0], 2)):
        path = network(tmp_path / "net.onnx", openmmlab(*rows, labels=labels))
        assert len(detector(path).detect(PICTURE)) == left


def test_the_network_sees_blue_first_bytes_in_the_upper_left_of_grey(tmp_path):
    """Scores are pixels of the input: its first, blue; its first, red; its last row, blue."""

    def constant(name, value):
        array = np.array(value, np.int64 if name != "scale" else np.float32)
        return helper.make_node("Constant", [], [name], value=numpy_helper.from_array(array))

    nodes = [constant("axes", [1, 2, 3]), constant("scale", 1 / 255), constant("flat", [1, 1, 1])]
    for k, (channel, row) in enumerate([(0, 0), (2, 0), (0, SIDE - 1)]):
        nodes += [
            constant(f"from{k}", [channel, row, 0]),
            constant(f"to{k}", [channel + 1, row + 1, 1]),
            helper.make_node("Slice", ["picture", f"from{k}", f"to{k}", "axes"], [f"pixel{k}"]),
            helper.make_node("Mul", [f"pixel{k}", "scale"], [f"scaled{k}"]),
            helper.make_node("Reshape", [f"scaled{k}", "flat"], [f"score{k}"]),
        ]
    boxes = np.array([[[0, 0, 9, 9], [20, 0, 29, 9], [40, 0, 49, 9]]], np.float32)
    nodes += [
        helper.make_node("Constant", [], ["boxes"], value=numpy_helper.from_array(boxes)),
        helper.make_node("Concat", ["score0", "score1", "score2"], ["scores"], axis=1),
        helper.make_node("Concat", ["boxes", "scores"], ["dets"], axis=2),
    ]
    outputs = {"dets": None, "labels": np.zeros((1, 3), np.int64)}
    path = network(tmp_path / "net.onnx", outputs, nodes=nodes)
    image = np.zeros((100, 200, 3), np.uint8)
    image[:] = 200, 100, 50
    modest = detector(path)
    modest.whole_threshold = 0.1
    found = modest.detect(image)
    score = found.confidence[np.argsort(found.xyxy[:, 0])] * 255
    assert score == pytest.approx([200, 50, 114], abs=1e-3)


def test_an_open_size_needs_input_px(tmp_path):
    outputs = openmmlab([0, 0, 48, 96, 0.9])
    path = network(tmp_path / "net.onnx", outputs, shape=("n", 3, "h", "w"))
    with pytest.raises(InputError, match=r"net\.onnx: the size of .* is open; give input_px"):
        OnnxYoloxDetector(path)
    with pytest.raises(InputError, match="input_px: found 100, expected a multiple of 32"):
        OnnxYoloxDetector(path, input_px=100)
    found = OnnxYoloxDetector(path, input_px=96).detect(np.zeros((50, 50, 3), np.uint8))
    assert found.xyxy == pytest.approx(np.array([[-0.5, -0.5, 24.5, 49.5]]))
    assert found.data["class_name"].tolist() == ["person"]


def test_an_input_that_is_not_square(tmp_path):
    path = network(tmp_path / "net.onnx", openmmlab([0, 0, 32, 16, 0.9]), shape=(1, 3, 32, 64))
    found = OnnxYoloxDetector(path).detect(np.zeros((64, 64, 3), np.uint8))
    assert found.xyxy == pytest.approx(np.array([[-0.5, -0.5, 63.5, 31.5]]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: p, "there is no such file"),
        (lambda p: p.write_text("no network") and p, "not a network that ONNX Runtime can open"),
        (
            lambda p: network(p, {"out": np.zeros((1, 84, 8400), np.float32)}),
            r"found outputs out \(1, 84, 8400\), expected boxes",
        ),
        (lambda p: network(p, head(classes=80)), r"\(1, 84, 85\), .* 2 class names"),
        (
            lambda p: network(p, openmmlab([0, 0, 9, 9, 0.5]), shape=(1, 1, 64, 64)),
            "found 1 channels",
        ),
        (lambda p: network(p, openmmlab([0, 0, 9, 9, 0.5]), shape=(4, 3, 64, 64)), "a batch of 4"),
        (
            lambda p: network(p, openmmlab([0, 0, 9, 9, 0.5]), kind=TensorProto.UINT8),
            r"expected one \(1, 3, h, w\) of float32",
        ),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, make, message):
    path = tmp_path / "net.onnx"
    make(path)
    with pytest.raises(InputError, match=r"net\.onnx: .*" + message):
        OnnxYoloxDetector(path, class_names=NAMES)


def test_a_size_that_is_fixed_and_class_names_that_are_short(tmp_path):
    path = network(tmp_path / "net.onnx", openmmlab([0, 0, 9, 9, 0.9], labels=[5]))
    with pytest.raises(InputError, match="input_px 128 was given, but the network takes 64x64"):
        OnnxYoloxDetector(path, input_px=128)
    with pytest.raises(InputError, match="found class number 5, expected 0 to 1 for 2"):
        detector(path).detect(PICTURE)


def test_only_pictures_in_bytes_are_taken(tmp_path):
    require_bgr(PICTURE)
    for wrong in (PICTURE[..., 0], PICTURE.astype(float), PICTURE[:0], PICTURE[..., :2]):
        with pytest.raises(
            InputError, match=r"image: found shape .* expected \(height, width, 3\)"
        ):
            require_bgr(wrong)
