"""YOLOv4-tiny, for vehicles: trained on COCO, run by OpenCV.

Source: Bochkovskiy, Wang, Liao, "YOLOv4: Optimal Speed and Accuracy of Object Detection" (2020),
and "Scaled-YOLOv4" (CVPR 2021), by the same authors; weights of the Darknet project.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES
from scene4d.perception.detectors.coco import COCO80
from scene4d.perception.detectors.tiled import Boxes, TiledDetector
from scene4d.perception.detectors.tiles import ExpectedPersonPx, Sight
from scene4d.perception.session import DEFAULT_THREADS
from scene4d.perception.weights import weight_path

_INPUT_PX = 608
_WHOLE_THRESHOLD = 0.3
_TILE_THRESHOLD = 0.4

# 37 vehicles of two MEVA frames, drawn by hand and shrunk step by step: recall 0.9 from 20 px on
# (measured along the longer side's scale), 0.6 at 13 px, 0.3 at 10 px.
_SMALL_PX = 20.0
_HOPELESS_PX = 12.0
_TILE_SHARE = 960 / 608
_CELL_PX = 32
_FIXED = 5  # columns before the classes: box and objectness
_KEPT = np.array([k for k, name in enumerate(COCO80) if name in CLASSES])


class Yolov4TinyDetector(TiledDetector):
    """Finds persons, bicycles, motorcycles, cars, trucks and buses; ``class_id`` counts as COCO.

    The picture is stretched to a square of ``input_px`` (a multiple of 32): that shows vehicles
    higher than keeping its aspect would, and found more of them. Classes compete: a thing that
    looks more like something else than like these six is left out. Other arguments as in
    :class:`~scene4d.perception.detectors.tiled.TiledDetector`; ``weights`` and ``layers`` (the
    Darknet cfg) None are those of the weight store. Scores below 0.2 do not exist.
    """

    def __init__(
        self,
        weights: Path | None = None,
        layers: Path | None = None,
        *,
        threads: int = DEFAULT_THREADS,
        input_px: int = _INPUT_PX,
        whole_threshold: float = _WHOLE_THRESHOLD,
        tile_threshold: float = _TILE_THRESHOLD,
        tiles: bool | None = None,
        expected_person_px: ExpectedPersonPx | None = None,
    ) -> None:
        if input_px < _CELL_PX or input_px % _CELL_PX:
            raise InputError(f"input_px: found {input_px}, expected a multiple of {_CELL_PX}")
        super().__init__(
            class_names=COCO80,
            sight=Sight(input_px, round(_TILE_SHARE * input_px), _SMALL_PX, _HOPELESS_PX),
            whole_threshold=whole_threshold,
            tile_threshold=tile_threshold,
            tiles=tiles,
            expected_person_px=expected_person_px,
        )
        weights = weight_path("yolov4-tiny") if weights is None else weights
        layers = weight_path("yolov4-tiny-layers") if layers is None else layers
        self._threads = threads
        self._lock = threading.Lock()  # the network keeps its input between two calls
        try:
            self._net = cv2.dnn.readNetFromDarknet(str(layers), str(weights))
        except cv2.error as error:
            raise InputError(
                f"{layers}, {weights}: not a Darknet network that OpenCV can read: "
                f"{error.err or error}"
            ) from error
        self._outputs = self._net.getUnconnectedOutLayersNames()

    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture; see :meth:`TiledDetector.infer`."""
        side = self.sight.input_px
        square = cv2.resize(image_bgr, (side, side), interpolation=cv2.INTER_LINEAR)
        blob = cv2.dnn.blobFromImage(square, 1 / 255, swapRB=True)
        with self._lock, _opencv_threads(self._threads):
            self._net.setInput(blob)
            rows = np.concatenate(self._net.forward(self._outputs)).astype(float)
        # OpenCV has multiplied the classes by the objectness.
        score = rows[:, _FIXED:].max(axis=1)
        label = rows[:, _FIXED:].argmax(axis=1)
        chosen = (score >= max(threshold, np.finfo(float).tiny)) & np.isin(label, _KEPT)
        # Centre and size come as shares of the picture, which reaches from -0.5 to width - 0.5.
        height, width = image_bgr.shape[:2]
        centre, half = rows[chosen, :2], rows[chosen, 2:4] / 2
        size = np.array([width, height] * 2)
        xyxy = np.hstack([centre - half, centre + half]) * size - 0.5
        return Boxes(xyxy, score[chosen], label[chosen]).clipped(width, height)


@contextmanager
def _opencv_threads(count: int) -> Iterator[None]:
    """OpenCV knows one number of threads for all its work; it is put back afterwards."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(min(count, before) if before > 0 else count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
