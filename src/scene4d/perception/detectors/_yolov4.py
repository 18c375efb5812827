"""YOLOv4-tiny, for vehicles: trained on COCO, converted to ONNX when it is loaded.

Source: Bochkovskiy, Wang, Liao, "YOLOv4: Optimal Speed and Accuracy of Object Detection" (2020),
and "Scaled-YOLOv4" (CVPR 2021), by the same authors; weights of the Darknet project.
"""

import cv2
import numpy as np

from scene4d.core.tracks import CLASSES
from scene4d.perception._planes import fill_planes
from scene4d.perception._session import AUTO, open_coarse
from scene4d.perception.detectors._base import COCO80
from scene4d.perception.detectors._darknet import PICTURE, onnx_of_darknet
from scene4d.perception.detectors.tiles import Boxes, Sight, TiledDetector
from scene4d.perception.weights import weight_path

_INPUT_PX = 608
"""Side of the square input, a multiple of 32: one of those that YOLOv4 is published for."""
_WHOLE_THRESHOLD = 0.3
_TILE_THRESHOLD = 0.4
"""Scores from which a box is believed, in the whole frame and in a tile. Chosen by
hand on the tuning cameras."""
_TILE_PX = 960
"""Side of a tile for that input. Chosen by hand."""
_SMALL_PX = 20.0
_HOPELESS_PX = 12.0
"""Heights in the input from which recall is whole, and below which nothing helps: the 37
vehicles of tests/perception/meva_vehicles.csv, shrunk step by step, gave 0.9 from 20 px on (along
the longer side's scale), 0.6 at 13 px and 0.3 at 10 px."""
_BOX = 4  # columns before the classes
_KEPT = np.array([k for k, name in enumerate(COCO80) if name in CLASSES])


class Yolov4TinyDetector(TiledDetector):
    """Finds persons, bicycles, motorcycles, cars, trucks and buses; ``class_id`` counts as COCO.

    The picture is stretched to a square: that shows vehicles higher than keeping its aspect would,
    and found more of them. Classes compete: a thing that looks more like something else than like
    these six is left out. Gets the weights if they are missing.
    """

    def __init__(self, device: str = AUTO) -> None:
        super().__init__(
            class_names=COCO80,
            sight=Sight(_INPUT_PX, _TILE_PX, _SMALL_PX, _HOPELESS_PX),
            whole_threshold=_WHOLE_THRESHOLD,
            tile_threshold=_TILE_THRESHOLD,
        )
        layers, weights = weight_path("yolov4-tiny-layers"), weight_path("yolov4-tiny")
        network = onnx_of_darknet(layers.read_text(), weights.read_bytes(), (_INPUT_PX, _INPUT_PX))
        self._session = open_coarse(network, device)

    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture; see :meth:`TiledDetector.infer`."""
        square = cv2.resize(image_bgr, (_INPUT_PX, _INPUT_PX), interpolation=cv2.INTER_LINEAR)
        blob = np.empty((1, 3, _INPUT_PX, _INPUT_PX), np.float32)
        fill_planes(blob[0], square, 1 / 255, swapped=True)
        rows = self._session.run(None, {PICTURE: blob})[0][0].astype(float)
        score, label = rows[:, _BOX:].max(axis=1), rows[:, _BOX:].argmax(axis=1)
        chosen = (score >= threshold) & np.isin(label, _KEPT)
        # Corners come as shares of the picture, which reaches from -0.5 to width - 0.5.
        height, width = image_bgr.shape[:2]
        xyxy = rows[chosen, :_BOX] * np.array([width, height] * 2) - 0.5
        return Boxes(xyxy, score[chosen], label[chosen]).clipped(width, height)
