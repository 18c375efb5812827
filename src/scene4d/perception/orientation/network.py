"""The orientation network: one picture in, a belief about its camera out.

An image classifier over bins of the camera's pose, as the paper takes from Abbas & Zisserman (2019,
"A Geometric Approach to Obtain a Bird's Eye View from an Image"), here taught to point at up and
the horizon everywhere in the picture as well. Trained by ``training/``; its model card is
docs/orientation.md.
"""

from functools import cached_property
from importlib.resources import files

import cv2
import numpy as np
from jaxtyping import Float
from scipy.special import log_softmax

from scene4d.core.errors import InputError
from scene4d.perception.orientation.grid import Belief, crop_size

_INPUT_SIZE = (192, 144)
"""Width and height that the network looks at, pixels."""
_WEIGHTS = "network.onnx"
_SMALLEST = 32


def centre_crop(image_bgr: np.ndarray) -> np.ndarray:
    """The largest centred 4:3 part of a picture (h, w, 3), a view of it."""
    height, width = image_bgr.shape[:2]
    across, along = crop_size((width, height))
    left, top = (width - across) // 2, (height - along) // 2
    return image_bgr[top : top + along, left : left + across]


class OrientationNetwork:
    """The packaged network, or one given as the bytes of its ONNX file; loaded when first used."""

    def __init__(self, onnx_bytes: bytes | None = None) -> None:
        self._given = onnx_bytes

    @cached_property
    def _session(self):  # type: ignore[no-untyped-def]
        import onnxruntime

        model = self._given
        if model is None:
            model = files("scene4d.perception.orientation").joinpath(_WEIGHTS).read_bytes()
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def belief(self, image_bgr: np.ndarray) -> Belief:
        """What one picture (h, w, 3), 8-bit BGR, says about its camera.

        Raises :class:`InputError` for a picture that is not 8-bit BGR or smaller than 32 pixels.
        """
        _, roll, pose = self.outputs(image_bgr)
        return Belief.normalised(roll[:, None, None] + pose[None])

    def outputs(
        self, image_bgr: np.ndarray
    ) -> tuple[Float[np.ndarray, "4 r c"], Float[np.ndarray, "33"], Float[np.ndarray, "37 21"]]:
        """The dense head's cells, and the log-probabilities of roll and of (tilt, field of view).

        The picture and its mirror image are looked at; a mirrored camera has the opposite roll.
        """
        small = _prepared(image_bgr)
        both = np.stack([small, small[:, ::-1]])
        batch = np.ascontiguousarray(both[..., ::-1].transpose(0, 3, 1, 2), dtype=np.float32)
        dense, roll, pose = self._session.run(None, {"picture": batch})
        mirrored = dense[1, :, :, ::-1] * np.array([-1, 1, 1, 1], np.float32)[:, None, None]
        roll = log_softmax(roll.astype(np.float64), axis=1)
        pose = log_softmax(pose.astype(np.float64), axis=(1, 2))
        return (
            (dense[0] + mirrored) / 2,
            (roll[0] + roll[1, ::-1]) / 2,
            (pose[0] + pose[1]) / 2,
        )


def _prepared(image_bgr: np.ndarray) -> np.ndarray:
    if image_bgr.ndim != 3 or image_bgr.shape[2] != 3 or image_bgr.dtype != np.uint8:
        raise InputError(
            f"orientation: expected a picture (h, w, 3) of 8-bit BGR, found shape "
            f"{image_bgr.shape} of {image_bgr.dtype}"
        )
    part = centre_crop(image_bgr)
    if min(part.shape[:2]) < _SMALLEST:
        height, width = image_bgr.shape[:2]
        raise InputError(
            f"orientation: the picture of {width}x{height} pixels is too small; its centred 4:3 "
            f"part needs at least {_SMALLEST} pixels each way"
        )
    shrink = part.shape[0] > _INPUT_SIZE[1]
    how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
    return cv2.resize(part, _INPUT_SIZE, interpolation=how)
