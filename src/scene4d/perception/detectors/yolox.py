"""Networks with the YOLOX layout through ONNX Runtime: YOLOX-tiny for persons, or one of yours.

Source: Ge et al., "YOLOX: Exceeding YOLO Series in 2021". Two exports of it are in use: that of
OpenMMLab, with the suppression of duplicates inside, and the authors' own, which leaves the head's
output as it is, one row per cell of three or four grids. YOLOX-tiny is that of the RTMPose project,
trained on persons of COCO and Human-Art.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from scene4d.core.errors import InputError, Scene4DError
from scene4d.perception._session import AUTO, open_coarse, open_session
from scene4d.perception.detectors._base import COCO80
from scene4d.perception.detectors.tiles import INPUT_PX, Boxes, Sight, TiledDetector
from scene4d.perception.weights import weight_path

_WHOLE_THRESHOLD = 0.4
_TILE_THRESHOLD = 0.55
"""Scores from which a box is believed, in the whole frame and in a tile, where things without
their surroundings are mistaken more often. Chosen by hand on the tuning cameras."""

_PAD = 114.0  # grey level around the picture, as the networks were trained
_STRIDES = ((8, 16, 32), (8, 16, 32, 64))
_COARSEST = 32
_FIXED = 5  # columns before the classes: box and objectness


class OnnxYoloxDetector(TiledDetector):
    """Finds what a YOLOX network of yours was trained on; which layout it has is found out.

    The network takes one picture (1, 3, height, width), blue first, 0-255, resized into the upper
    left of a canvas of grey 114. Layouts: outputs (1, n, 5) = x1 y1 x2 y2 score and (1, n) = class
    number, boxes in pixels of the input; or one output (1, cells, 5 + classes), whose boxes are
    offsets in their cells or decoded already. ``input_px`` is the side of a square input, needed
    where the file leaves it open. Raises :class:`InputError` for a file that is none of these.
    """

    def __init__(
        self,
        path: Path,
        *,
        class_names: Sequence[str] = COCO80,
        input_px: int | None = None,
        device: str = AUTO,
    ) -> None:
        self._path = path
        self._session = _open(path, device)
        self._input, self._size = _input_of(path, self._session, input_px)
        super().__init__(
            class_names=tuple(class_names),
            sight=Sight.of_input(max(self._size)),
            whole_threshold=_WHOLE_THRESHOLD,
            tile_threshold=_TILE_THRESHOLD,
        )
        self._choose_layout()
        self.canvases = (self._size,)

    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture; see :meth:`TiledDetector.infer`."""
        height, width = image_bgr.shape[:2]
        scale = min(self._size[0] / width, self._size[1] / height)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        columns, rows = self._canvas_size(size)
        canvas = np.full((rows, columns, 3), _PAD, np.float32)
        canvas[: size[1], : size[0]] = cv2.resize(image_bgr, size, interpolation=cv2.INTER_LINEAR)
        found = self.infer_canvas(canvas, threshold)
        # The network's boxes measure from the image's edge, not from the first pixel's centre.
        shrink = np.array([size[0] / width, size[1] / height] * 2)
        return found._replace(xyxy=found.xyxy / shrink - 0.5).clipped(width, height)

    def infer_canvas(self, canvas: np.ndarray, threshold: float) -> Boxes:
        """What the network says of its input; see :meth:`TiledDetector.infer_canvas`."""
        return self._read(self._run(canvas), threshold)

    def _canvas_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Width and height of the input for a picture that has been shrunk to ``size``."""
        return self._size

    def _session_for(self, size: tuple[int, int]) -> Any:
        return self._session

    def _run(self, canvas: np.ndarray) -> list[np.ndarray]:
        blob = np.ascontiguousarray(canvas.transpose(2, 0, 1)[None])
        session = self._session_for((canvas.shape[1], canvas.shape[0]))
        outputs: list[np.ndarray] = session.run(self._outputs, {self._input: blob})
        return outputs

    def _choose_layout(self) -> None:
        """Run the network once on an empty canvas, and see what comes out."""
        self._outputs: list[str] | None = None
        canvas = np.full((self._size[1], self._size[0], 3), _PAD, np.float32)
        try:
            found = self._run(canvas)
        except Exception as error:  # onnxruntime's errors have no base of their own
            raise InputError(f"{self._path}: the network cannot be run: {error}") from error
        names = [o.name for o in self._session.get_outputs()]
        dets = [k for k, a in enumerate(found) if a.ndim == 3 and a.shape[::2] == (1, _FIXED)]
        labels = [k for k, a in enumerate(found) if a.ndim == 2 and a.dtype.kind == "i"]
        self._grid = None
        if len(dets) == len(labels) == 1:
            self._outputs = [names[dets[0]], names[labels[0]]]
            return
        grids = [_grid(self._size, strides) for strides in _STRIDES]
        columns = _FIXED + len(self.class_names)
        for k, output in enumerate(found):
            for grid in grids:
                if output.shape == (1, len(grid), columns):
                    self._outputs = [names[k]]
                    self._grid = None if _decoded(output[0], self._size) else grid
                    return
        said = ", ".join(f"{n} {tuple(a.shape)}" for n, a in zip(names, found, strict=True))
        cells = " or ".join(str(len(grid)) for grid in grids)
        raise InputError(
            f"{self._path}: found outputs {said}, expected boxes (1, n, 5) with labels (1, n), or "
            f"(1, {cells}, {columns}) for an input of {self._size[0]}x{self._size[1]} and "
            f"{len(self.class_names)} class names; give the names it was trained on, or export it "
            "again as YOLOX or OpenMMLab do"
        )

    def _read(self, outputs: list[np.ndarray], threshold: float) -> Boxes:
        if len(outputs) == 2:
            dets, label = outputs[0][0], outputs[1][0]
            rows = dets[:, 4] >= threshold
            found = Boxes(dets[rows, :4].astype(float), dets[rows, 4].astype(float), label[rows])
        else:
            found = _best_classes(outputs[0][0], self._grid, threshold)
        if len(found.label) and not 0 <= found.label.min() <= found.label.max() < len(
            self.class_names
        ):
            raise InputError(
                f"{self._path}: found class number {int(found.label.max())}, expected 0 to "
                f"{len(self.class_names) - 1} for {len(self.class_names)} class names"
            )
        return found._replace(label=found.label.astype(np.int64))


class YoloxDetector(OnnxYoloxDetector):
    """YOLOX-tiny, which finds persons; gets the weights if they are missing.

    A picture is not padded to a square: 4:3 takes three quarters of the time then, 16:9 six tenths.
    """

    canvases = ((160, 160), (256, 224), (INPUT_PX, INPUT_PX))

    def __init__(self, device: str = AUTO) -> None:
        self._path, self._device = weight_path("yolox-tiny"), device
        self._size, self._input, self._outputs = (INPUT_PX, INPUT_PX), "input", ["dets", "labels"]
        self._grid = None
        self._sessions: dict[tuple[int, int], Any] = {}
        TiledDetector.__init__(
            self,
            class_names=("person",),
            sight=Sight(),
            whole_threshold=_WHOLE_THRESHOLD,
            tile_threshold=_TILE_THRESHOLD,
        )

    def _canvas_size(self, size: tuple[int, int]) -> tuple[int, int]:
        return size[0] + -size[0] % _COARSEST, size[1] + -size[1] % _COARSEST

    def _session_for(self, size: tuple[int, int]) -> Any:
        if size not in self._sessions:
            self._sessions[size] = open_coarse(_of_size(self._path, size), self._device)
        return self._sessions[size]


def _of_size(path: Path, size: tuple[int, int]) -> bytes:
    """YOLOX-tiny for pictures of another (width, height), multiples of its coarsest stride.

    The file holds the shapes of the first layer, which puts every second row and column into a
    channel of its own, a table of where the cells are, one of their strides, and their number.
    """
    import onnx

    model = onnx.load(path)
    shape = model.graph.input[0].type.tensor_type.shape.dim
    before = (shape[3].dim_value, shape[2].dim_value)
    shape[2].dim_value, shape[3].dim_value = size[1], size[0]
    del model.graph.value_info[:]  # shapes within, for the old size
    cells = len(_grid(before, _STRIDES[0]))
    grid = _grid(size, _STRIDES[0]).astype(np.float32)
    for constant in model.graph.initializer:
        if list(constant.dims) != [cells, 2] and constant.data_type != onnx.TensorProto.INT64:
            continue  # weights
        old = onnx.numpy_helper.to_array(constant)
        new = old.copy()
        if old.shape == (cells, 2):
            new = grid[:, 2:] * (grid[:, :2] if (old[0] == 0).all() else 1)
        elif old.shape == (1,) and old[0] == cells:
            new[:] = len(grid)
        elif old.ndim == 1:
            halves = np.flatnonzero(old == before[0] // 2)
            new[halves] = (size[1] // 2, size[0] // 2)[: len(halves)]
        constant.CopyFrom(onnx.numpy_helper.from_array(new, constant.name))
    return bytes(model.SerializeToString())


def _best_classes(rows: np.ndarray, grid: np.ndarray | None, threshold: float) -> Boxes:
    """Boxes of the head's rows that reach the threshold; ``grid`` None where they are decoded."""
    score = rows[:, 4] * rows[:, _FIXED:].max(axis=1)
    chosen = np.flatnonzero(score >= threshold)
    middle, size = rows[chosen, :2].astype(float), rows[chosen, 2:4].astype(float)
    if grid is not None:
        corner, stride = grid[chosen, :2], grid[chosen, 2:]
        middle, size = (middle + corner) * stride, np.exp(size) * stride
    xyxy = np.hstack([middle - size / 2, middle + size / 2])
    label = rows[chosen, _FIXED:].argmax(axis=1)
    return Boxes(xyxy, score[chosen].astype(float), label)


def _grid(size: tuple[int, int], strides: tuple[int, ...]) -> np.ndarray:
    """Column, row and stride (twice) of every cell (cells, 4), in the order of the head's rows."""
    parts = []
    for stride in strides:
        v, u = np.mgrid[: size[1] // stride, : size[0] // stride]
        step = np.full(u.size, stride)
        parts.append(np.column_stack([u.ravel(), v.ravel(), step, step]))
    return np.concatenate(parts).astype(float)


def _decoded(rows: np.ndarray, size: tuple[int, int]) -> bool:
    """Whether boxes are in pixels already: they lie all over the input then.

    An offset in a cell is a few cells at most, so half of the rows are close to 0.
    """
    return bool(np.median(rows[:, 0]) > size[0] / 8)


def _open(path: Path, device: str) -> Any:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file, expected a network in ONNX format")
    try:
        return open_session(path, device)
    except Scene4DError:
        raise
    except Exception as error:  # onnxruntime's errors have no base of their own
        raise InputError(f"{path}: not a network that ONNX Runtime can open: {error}") from error


def _input_of(path: Path, session: Any, input_px: int | None) -> tuple[str, tuple[int, int]]:
    """Name of the input, and the width and height that it takes."""
    inputs = session.get_inputs()
    said = ", ".join(f"{i.name} {i.shape} {i.type}" for i in inputs)
    first = inputs[0]
    if len(inputs) != 1 or len(first.shape) != 4 or first.type != "tensor(float)":
        raise InputError(f"{path}: found inputs {said}, expected one (1, 3, h, w) of float32")
    batch, channels, height, width = first.shape
    if channels not in (3, None) and not isinstance(channels, str):
        raise InputError(f"{path}: found {channels} channels in {said}, expected 3")
    if isinstance(batch, int) and batch != 1:
        raise InputError(f"{path}: found a batch of {batch} in {said}, expected 1")
    if isinstance(height, int) and isinstance(width, int):
        if input_px is not None and (width, height) != (input_px, input_px):
            raise InputError(
                f"{path}: input_px {input_px} was given, but the network takes {width}x{height}"
            )
        return first.name, (width, height)
    if input_px is None:
        raise InputError(f"{path}: the size of {said} is open; give input_px, such as 640")
    if input_px < 32 or input_px % 32:
        raise InputError(f"input_px: found {input_px}, expected a multiple of 32")
    return first.name, (input_px, input_px)
