"""YOLOv4-tiny, for vehicles: trained on COCO, run by OpenCV.

Source: Bochkovskiy, Wang, Liao, "YOLOv4: Optimal Speed and Accuracy of Object Detection" (2020),
and "Scaled-YOLOv4" (CVPR 2021), by the same authors; weights of the Darknet project.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np

from scene4d.core.tracks import CLASSES
from scene4d.perception._session import THREADS
from scene4d.perception.detectors._base import COCO80
from scene4d.perception.detectors.tiles import Boxes, Sight, TiledDetector
from scene4d.perception.weights import weight_path

_INPUT_PX = 608
"""Side of the square input, a multiple of 32: one of those that YOLOv4 is published for."""
_WHOLE_THRESHOLD = 0.3
_TILE_THRESHOLD = 0.4
"""Scores from which a box is believed, in the whole frame and in a tile; below 0.2 there are none.
Chosen by hand on the tuning cameras."""
_TILE_PX = 960
"""Side of a tile for that input. Chosen by hand."""
_SMALL_PX = 20.0
_HOPELESS_PX = 12.0
"""Heights in the input from which recall is whole, and below which nothing helps: the 37
vehicles of tests/perception/meva_vehicles.csv, shrunk step by step, gave 0.9 from 20 px on (along
the longer side's scale), 0.6 at 13 px and 0.3 at 10 px."""
_FIXED = 5  # columns before the classes: box and objectness
_KEPT = np.array([k for k, name in enumerate(COCO80) if name in CLASSES])


class Yolov4TinyDetector(TiledDetector):
    """Finds persons, bicycles, motorcycles, cars, trucks and buses; ``class_id`` counts as COCO.

    The picture is stretched to a square: that shows vehicles higher than keeping its aspect would,
    and found more of them. Classes compete: a thing that looks more like something else than like
    these six is left out. Gets the weights if they are missing.
    """

    def __init__(self) -> None:
        super().__init__(
            class_names=COCO80,
            sight=Sight(_INPUT_PX, _TILE_PX, _SMALL_PX, _HOPELESS_PX),
            whole_threshold=_WHOLE_THRESHOLD,
            tile_threshold=_TILE_THRESHOLD,
        )
        layers, weights = weight_path("yolov4-tiny-layers"), weight_path("yolov4-tiny")
        self._net = cv2.dnn.readNetFromDarknet(str(layers), str(weights))
        self._outputs = self._net.getUnconnectedOutLayersNames()
        self._lock = threading.Lock()  # the network keeps its input between two calls

    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture; see :meth:`TiledDetector.infer`."""
        square = cv2.resize(image_bgr, (_INPUT_PX, _INPUT_PX), interpolation=cv2.INTER_LINEAR)
        blob = cv2.dnn.blobFromImage(square, 1 / 255, swapRB=True)
        with self._lock, _opencv_threads(THREADS):
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
