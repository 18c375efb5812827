"""YOLOX-tiny person detector through ONNX Runtime, with tiles where people are small.

Source: Ge et al., "YOLOX: Exceeding YOLO Series in 2021"; weights of the RTMPose project, trained
on persons of COCO and Human-Art.
"""

import copy
from pathlib import Path

import cv2
import numpy as np
import supervision as sv
from jaxtyping import UInt8

from scene4d.perception.detectors.tiles import (
    INPUT_PX,
    ExpectedPersonPx,
    choose_tiles,
    cut_by_tile,
)
from scene4d.perception.session import DEFAULT_THREADS, open_session
from scene4d.perception.weights import weight_path

WHOLE_THRESHOLD = 0.4
TILE_THRESHOLD = 0.55
NMS_IOU = 0.5

_PAD = 114.0


class YoloxDetector:
    """Finds persons; boxes are pixels of the image given, pixel centres at integers.

    ``tiles`` None decides by the image's size: tiles are used where they show people clearly
    larger than the whole frame does. ``expected_person_px`` restricts them to where people would
    be too small in the whole frame.
    """

    def __init__(
        self,
        weights: Path | None = None,
        *,
        threads: int = DEFAULT_THREADS,
        whole_threshold: float = WHOLE_THRESHOLD,
        tile_threshold: float = TILE_THRESHOLD,
        tiles: bool | None = None,
        expected_person_px: ExpectedPersonPx | None = None,
    ) -> None:
        path = weight_path("yolox-tiny") if weights is None else weights
        self._session = open_session(path, threads)
        self._input = self._session.get_inputs()[0].name
        self.whole_threshold = whole_threshold
        self.tile_threshold = tile_threshold
        self.tiles = tiles
        self.expected_person_px = expected_person_px

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Persons of one image, best first; class 0."""
        box, score = self._infer(image_bgr, self.whole_threshold)
        boxes, scores = [box], [score]
        image_size = (image_bgr.shape[1], image_bgr.shape[0])
        for tile in choose_tiles(image_size, self.expected_person_px, use=self.tiles):
            x1, y1, x2, y2 = tile
            box, score = self._infer(image_bgr[y1:y2, x1:x2], self.tile_threshold)
            box = box + np.array([x1, y1, x1, y1])
            whole = ~cut_by_tile(box, tile, image_size)
            boxes.append(box[whole])
            scores.append(score[whole])
        box, score = np.concatenate(boxes), np.concatenate(scores)
        order = np.argsort(-score)
        found = sv.Detections(
            xyxy=box[order], confidence=score[order], class_id=np.zeros(len(box), np.int64)
        )
        return found.with_nms(NMS_IOU)

    def expecting(self, expected_person_px: ExpectedPersonPx | None) -> "YoloxDetector":
        """The same detector for a scene where the size of people is known; shares the network."""
        other = copy.copy(self)
        other.expected_person_px = expected_person_px
        return other

    def _infer(self, image_bgr: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray]:
        height, width = image_bgr.shape[:2]
        scale = INPUT_PX / max(height, width)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        canvas = np.full((INPUT_PX, INPUT_PX, 3), _PAD, np.float32)
        canvas[: size[1], : size[0]] = cv2.resize(image_bgr, size, interpolation=cv2.INTER_LINEAR)
        blob = canvas.transpose(2, 0, 1)[None]
        dets = self._session.run(["dets"], {self._input: np.ascontiguousarray(blob)})[0][0]
        dets = dets[dets[:, 4] >= threshold].astype(float)
        # The network's boxes measure from the image's edge, not from the first pixel's centre.
        shrink = np.array([size[0] / width, size[1] / height] * 2)
        box = dets[:, :4] / shrink - 0.5
        box[:, 0::2] = box[:, 0::2].clip(-0.5, width - 0.5)
        box[:, 1::2] = box[:, 1::2].clip(-0.5, height - 0.5)
        keep = (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1])
        return box[keep], dets[keep, 4]
