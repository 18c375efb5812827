"""YOLOX-tiny person detector through ONNX Runtime, with tiles where people are small.

Source: Ge et al., "YOLOX: Exceeding YOLO Series in 2021"; weights of the RTMPose project, trained
on persons of COCO and Human-Art.
"""

from pathlib import Path

from scene4d.perception.detectors.onnx_yolox import (
    TILE_THRESHOLD,
    WHOLE_THRESHOLD,
    OnnxYoloxDetector,
)
from scene4d.perception.detectors.tiles import ExpectedPersonPx
from scene4d.perception.session import DEFAULT_THREADS
from scene4d.perception.weights import weight_path


class YoloxDetector(OnnxYoloxDetector):
    """Finds persons; boxes are pixels of the image given, pixel centres at integers.

    Arguments as in :class:`~scene4d.perception.detectors.tiled.TiledDetector`; ``weights`` None
    is the network of the weight store.
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
        super().__init__(
            weight_path("yolox-tiny") if weights is None else weights,
            class_names=("person",),
            threads=threads,
            whole_threshold=whole_threshold,
            tile_threshold=tile_threshold,
            tiles=tiles,
            expected_person_px=expected_person_px,
        )
