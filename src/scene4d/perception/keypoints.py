"""RTMPose: the 26 Halpe body keypoints of people with known boxes.

Source: Jiang et al., "RTMPose: Real-Time Multi-Person Pose Estimation based on MMPose" (2023);
coordinates are classified per axis as in Li et al., "SimCC" (ECCV 2022).
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from scene4d.core.body import HALPE26
from scene4d.perception._planes import fill_planes
from scene4d.perception._session import AUTO, open_coarse
from scene4d.perception.weights import weight_path

_INPUT = "input"
INPUT_SIZE = (192, 256)
"""Width and height of the network's input, pixels."""
_PADDING = 1.25
"""The crop is the box, extended to the input's aspect ratio, times this; as in training."""
_BINS_PER_PIXEL = 2
BATCH = 16
"""People per batch, chosen by hand to bound memory."""

_MEAN_RGB = np.array([123.675, 116.28, 103.53], np.float32)
_STD_RGB = np.array([58.395, 57.12, 57.375], np.float32)


def crop_transforms(
    box_xyxy: Float[np.ndarray, "n 4"],
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
    """Scale (n,) and shift (n, 2) with ``input_px = scale * image_px + shift``, for every box.

    Both axes have one scale: the box is extended, never squeezed, to the input's aspect ratio.
    Pixel centres are at integers in both images; the middle of the box maps to ``INPUT_SIZE / 2``,
    as in training.
    """
    width, height = INPUT_SIZE
    centre = (box_xyxy[:, :2] + box_xyxy[:, 2:]) / 2
    size = np.maximum(box_xyxy[:, 2:] - box_xyxy[:, :2], 1.0) * _PADDING
    scale = 1 / np.maximum(size[:, 0] / width, size[:, 1] / height)
    return scale, np.array([width, height]) / 2 - scale[:, None] * centre


def decode_simcc(logits: Float[np.ndarray, "n k b"]) -> tuple[np.ndarray, np.ndarray]:
    """Position (n, k) in bins, refined by a parabola's vertex, and the peak's height (n, k).

    The first and last bin lack a neighbour, so they are not refined.
    """
    bins = logits.shape[2]
    peak = logits.argmax(axis=2)
    inner = np.clip(peak, 1, bins - 2)
    left, middle, right = (
        np.take_along_axis(logits, (inner + d)[..., None], axis=2)[..., 0].astype(float)
        for d in (-1, 0, 1)
    )
    bend = left - 2 * middle + right
    step = np.divide(left - right, 2 * bend, out=np.zeros_like(bend), where=bend < 0)
    position = peak + np.where(peak == inner, np.clip(step, -0.5, 0.5), 0.0)
    return position, logits.max(axis=2).astype(float)


class KeypointEstimator:
    """RTMPose-s; downloads missing weights."""

    names: tuple[str, ...] = HALPE26

    def __init__(self, device: str = AUTO) -> None:
        self._session = open_coarse(weight_path("rtmpose-s"), device)

    def estimate(
        self, image_bgr: UInt8[np.ndarray, "h w 3"], box_xyxy: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, "n 26 2"], Float[np.ndarray, "n 26"]]:
        """Keypoints (n, 26, 2) in pixels of the image and their scores (n, 26) in [0, 1].

        A score is the lower of the two axes' peaks. The network is trained to output a peak of
        height 1 at the right place, so the raw peak is already a confidence; noise takes it
        slightly out of [0, 1], and it is clipped. Points may lie outside the image.
        """
        uv = np.empty((len(box_xyxy), len(HALPE26), 2))
        score = np.empty((len(box_xyxy), len(HALPE26)))
        scale, shift = crop_transforms(box_xyxy)
        for start in range(0, len(box_xyxy), BATCH):
            rows = slice(start, start + BATCH)
            crops = _crops(image_bgr, scale[rows], shift[rows])
            logits_x, logits_y = self._session.run(["simcc_x", "simcc_y"], {_INPUT: crops})
            x, peak_x = decode_simcc(logits_x)
            y, peak_y = decode_simcc(logits_y)
            inside = np.stack([x, y], axis=2) / _BINS_PER_PIXEL
            uv[rows] = (inside - shift[rows, None, :]) / scale[rows, None, None]
            score[rows] = np.clip(np.minimum(peak_x, peak_y), 0.0, 1.0)
        return uv, score


def _crops(image_bgr: np.ndarray, scale: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The network's input (n, 3, 256, 192): RGB, normalised as in training."""
    width, height = INPUT_SIZE
    crops = np.empty((len(scale), 3, height, width), np.float32)
    for crop, s, (tx, ty) in zip(crops, scale, shift, strict=True):
        matrix = np.array([[s, 0, tx], [0, s, ty]])
        warped = cv2.warpAffine(image_bgr, matrix, INPUT_SIZE, flags=cv2.INTER_LINEAR)
        fill_planes(crop, warped, 1 / _STD_RGB, _MEAN_RGB / _STD_RGB, swapped=True)
    return crops
