"""Networks of the Darknet project as ONNX: layers from a .cfg file, numbers from a .weights file.

Sources: Redmon, Farhadi, "YOLOv3: An Incremental Improvement" (2018), for boxes; Bochkovskiy, Wang,
Liao, "YOLOv4" (2020), for ``scale_x_y``. Layers that a YOLOv4-tiny is made of are known, no others.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from scene4d.core.errors import InputError

PICTURE, _FOUND = "picture", "found"
"""Names of the input and the output."""
_OPSET, _IR = 17, 8
"""Versions of ONNX that hold all operators used and that every engine of recent years reads."""
_HEADER_BYTES = 20  # three int32 of version, one int64 of pictures seen
_EPSILON = 1e-6  # added to the variance of a batch, as in Darknet
_SLOPE = 0.1  # of Darknet's leaky rectifier below zero
_FIXED = 5  # columns of a head before the classes: box and objectness


@dataclass(frozen=True)
class _Output:
    """What a layer gives: its name in the graph, channels, and pixels of the input per cell."""

    name: str
    channels: int
    stride: int


def onnx_of_darknet(cfg: str, weights: bytes, input_size: tuple[int, int]) -> bytes:
    """An ONNX file for pictures (batch, 3, height, width), red first, in [0, 1].

    ``input_size`` is (width, height), multiples of the coarsest stride. The one output (batch,
    cells, 4 + classes) holds the boxes x1 y1 x2 y2 as shares of the picture, then objectness times
    class probability. Raises :class:`InputError` for layers it does not know and for weights that
    do not belong to them.
    """
    sections = [s for s in _sections(cfg) if s["kind"] != "net"]
    graph = _Graph(weights[_HEADER_BYTES:], input_size)
    for section in sections:
        graph.add(section)
    return graph.finished()


def _sections(cfg: str) -> Iterator[dict[str, str]]:
    section: dict[str, str] = {}
    for line in (raw.split("#")[0].strip() for raw in cfg.splitlines()):
        if line.startswith("["):
            if section:
                yield section
            section = {"kind": line.strip("[]")}
        elif line:
            key, _, value = line.partition("=")
            section[key.strip()] = value.strip()
    if section:
        yield section


def _numbers(section: dict[str, str], key: str) -> list[int]:
    return [int(part) for part in section[key].split(",")]


class _Graph:
    """An ONNX graph that grows layer by layer."""

    def __init__(self, numbers: bytes, input_size: tuple[int, int]) -> None:
        self._numbers = np.frombuffer(numbers, "<f4")
        self._read = 0
        self._size = input_size
        self._nodes: list[Any] = []
        self._constants: list[Any] = []
        self._layers: list[_Output] = []
        self._heads: list[str] = []
        self._last = _Output(PICTURE, 3, 1)

    def add(self, section: dict[str, str]) -> None:
        """The next layer of the file."""
        kinds = {
            "convolutional": self._convolution,
            "route": self._route,
            "maxpool": self._max_pool,
            "upsample": self._upsample,
            "yolo": self._head,
        }
        if section["kind"] not in kinds:
            raise InputError(f"Darknet layer: found {section['kind']!r}, expected {list(kinds)}")
        self._last = kinds[section["kind"]](section)
        self._layers.append(self._last)

    def finished(self) -> bytes:
        """The content of the file."""
        if self._read != len(self._numbers):
            raise InputError(
                f"Darknet weights: found {len(self._numbers)} numbers, the layers take {self._read}"
            )
        self._node("Concat", self._heads, _FOUND, axis=1)
        width, height = self._size
        picture, found = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
            for name, shape in (
                (PICTURE, ("batch", 3, height, width)),
                (_FOUND, ("batch", None, None)),
            )
        )
        graph = helper.make_graph(self._nodes, "darknet", [picture], [found], self._constants)
        model = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR
        )
        return bytes(model.SerializeToString())

    def _node(self, kind: str, inputs: list[str], output: str = "", **how: Any) -> str:
        output = output or f"{kind.lower()}{len(self._nodes)}"
        self._nodes.append(helper.make_node(kind, inputs, [output], **how))
        return output

    def _constant(self, value: np.ndarray) -> str:
        name = f"constant{len(self._constants)}"
        self._constants.append(numpy_helper.from_array(value, name))
        return name

    def _take(self, *shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        values = self._numbers[self._read : self._read + count]
        if len(values) < count:
            raise InputError("Darknet weights: the file ends before the layers do")
        self._read += count
        return values.reshape(shape)

    def _convolution(self, section: dict[str, str]) -> _Output:
        filters, size, stride = (int(section[key]) for key in ("filters", "size", "stride"))
        bias, scale = self._take(filters), np.ones(filters, np.float32)
        if section.get("batch_normalize") == "1":
            scale, mean, variance = self._take(3, filters)
            scale = scale / np.sqrt(variance + _EPSILON)
            bias = bias - mean * scale
        kernel = self._take(filters, self._last.channels, size, size)
        constants = [kernel * scale[:, None, None, None], bias]
        pad = size // 2 if section.get("pad") == "1" else 0
        name = self._node(
            "Conv",
            [self._last.name, *(self._constant(c.astype(np.float32)) for c in constants)],
            strides=[stride, stride],
            pads=[pad] * 4,
        )
        activation = section.get("activation", "linear")
        if activation == "leaky":
            name = self._node("LeakyRelu", [name], alpha=_SLOPE)
        elif activation != "linear":
            raise InputError(f"Darknet activation: found {activation!r}, expected leaky or linear")
        return _Output(name, filters, self._last.stride * stride)

    def _route(self, section: dict[str, str]) -> _Output:
        here = len(self._layers)
        asked = [k if k >= 0 else here + k for k in _numbers(section, "layers")]
        parts = [self._layers[k] for k in asked]
        channels = sum(part.channels for part in parts)
        name = parts[0].name
        if len(parts) > 1:
            name = self._node("Concat", [part.name for part in parts], axis=1)
        groups = int(section.get("groups", 1))
        if groups > 1:
            channels //= groups
            begin = channels * int(section["group_id"])
            bounds = [self._constant(np.array([v])) for v in (begin, begin + channels, 1)]
            name = self._node("Slice", [name, *bounds])
        return _Output(name, channels, parts[0].stride)

    def _max_pool(self, section: dict[str, str]) -> _Output:
        size, stride = int(section["size"]), int(section["stride"])
        name = self._node(
            "MaxPool", [self._last.name], kernel_shape=[size, size], strides=[stride, stride]
        )
        return _Output(name, self._last.channels, self._last.stride * stride)

    def _upsample(self, section: dict[str, str]) -> _Output:
        factor = int(section["stride"])
        scales = self._constant(np.array([1, 1, factor, factor], np.float32))
        how = {
            "mode": "nearest",
            "coordinate_transformation_mode": "asymmetric",
            "nearest_mode": "floor",
        }
        name = self._node("Resize", [self._last.name, "", scales], **how)
        return _Output(name, self._last.channels, self._last.stride // factor)

    def _head(self, section: dict[str, str]) -> _Output:
        """Boxes and scores of one grid, one row per cell and anchor: YOLOv3, section 2.1."""
        anchors = np.array(_numbers(section, "anchors"), np.float32).reshape(-1, 2)
        anchors = anchors[_numbers(section, "mask")]
        columns, rows = (length // self._last.stride for length in self._size)
        values = _FIXED + int(section["classes"])
        cells = rows * columns
        shape = self._constant(np.array([-1, len(anchors), values, cells]))
        name = self._node("Reshape", [self._last.name, shape])
        name = self._node("Transpose", [name], perm=[0, 3, 1, 2])
        shape = self._constant(np.array([-1, cells * len(anchors), values]))
        name = self._node("Reshape", [name, shape])
        place, size, objectness, classes = self._split(name, [2, 2, 1, values - _FIXED])
        box = self._decoded(place, size, anchors, (columns, rows), float(section["scale_x_y"]))
        score = self._node(
            "Mul", [self._node("Sigmoid", [objectness]), self._node("Sigmoid", [classes])]
        )
        self._heads.append(self._node("Concat", [*box, score], axis=2))
        return self._last

    def _decoded(
        self,
        place: str,
        size: str,
        anchors: np.ndarray,
        grid: tuple[int, int],
        stretch: float,
    ) -> tuple[str, str]:
        """Corners of the boxes as shares of the picture, from what the network says of them."""
        columns, rows = grid
        v, u = np.mgrid[:rows, :columns].astype(np.float32)
        corner = np.column_stack([u.ravel(), v.ravel()]) - (stretch - 1) / 2
        corner = np.repeat(corner, len(anchors), axis=0) / [columns, rows]
        half = np.tile(anchors, (rows * columns, 1)) / self._size / 2
        factor = np.array([stretch / columns, stretch / rows])
        first, step, half_size = (
            self._constant(a.astype(np.float32)) for a in (corner, factor, half)
        )
        place = self._node("Mul", [self._node("Sigmoid", [place]), step])
        middle = self._node("Add", [place, first])
        half_box = self._node("Mul", [self._node("Exp", [size]), half_size])
        return self._node("Sub", [middle, half_box]), self._node("Add", [middle, half_box])

    def _split(self, name: str, parts: list[int]) -> list[str]:
        names = [f"{name}_{k}" for k in range(len(parts))]
        sizes = self._constant(np.array(parts))
        self._nodes.append(helper.make_node("Split", [name, sizes], names, axis=2))
        return names
