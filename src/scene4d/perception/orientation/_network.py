"""What a picture says about its camera: the reading of the orientation network, and straight lines.

The network is an image classifier over bins of the camera's pose, as the paper takes from Abbas &
Zisserman (2019, "A Geometric Approach to Obtain a Bird's Eye View from an Image"), here trained to
point at up and the horizon everywhere in the picture as well. ``training/`` trains it; its model
card is docs/orientation.md.
"""

import json
from functools import cached_property
from importlib.resources import files

import cv2
import numpy as np
from jaxtyping import Float
from scipy.special import log_softmax

from scene4d.core.errors import InputError
from scene4d.perception._session import open_session
from scene4d.perception.detectors._base import require_bgr
from scene4d.perception.orientation._lines import line_log_likelihood
from scene4d.perception.orientation.grid import SHAPE, Belief, centre_crop

_INPUT_SIZE = (192, 144)
"""Width and height that the network looks at, pixels."""
_WEIGHTS = "network.onnx"
_SMALLEST = 32
"""Pixels each way below which a picture is refused."""

_NETWORK_POWER = 0.9
_LINE_POWER = 0.75
"""Exponents of the two, with the best log score together on the validation panoramas
(``python -m training.card --fit``). Below one: each is a little too sure, and lines repeat one
another; and what one of them sees, the other partly sees as well."""
_RECOGNISED_NATS = 3.0
"""Lines count in full where the network has learned this much (three in four validation crops), and
not at all where it has learned nothing: a picture on its side is full of good lines that lie. The
same holds of how often tilts were trained, which a picture without information knows nothing of."""
_TRAINED_TILTS = "log_tilt_given_vfov"
"""Entry of the ONNX file's metadata: rows of tilt, columns of field of view, as JSON."""
_FIRST_LINES = 4
_LINES_EVERY = 8
"""A still camera's lines are looked for in so many pictures at first, then in one of so many.
Over 32 frames of each of 16 recordings (../shared/data: PETS, TownCentre, footage) no value moved
by more than 0.33 of its standard deviation against reading the lines of all, most by less than
0.12; three to four times faster."""


class OrientationNetwork:
    """The packaged network, or one given as the bytes of its ONNX file; loaded when first used."""

    def __init__(self, onnx_bytes: bytes | None = None) -> None:
        self._given = onnx_bytes

    @cached_property
    def _session(self):  # type: ignore[no-untyped-def]
        if self._given is not None:
            return open_session(self._given)
        return open_session(files("scene4d.perception.orientation").joinpath(_WEIGHTS).read_bytes())

    def belief(self, image_bgr: np.ndarray) -> Belief:
        """What one picture (h, w, 3), 8-bit BGR, says about its camera.

        Raises :class:`InputError` for a picture that is not 8-bit BGR or smaller than 32 pixels.
        """
        _, roll, pose = self.outputs(image_bgr)
        seen = Belief.normalised(roll[:, None, None] + pose[None])
        share = _recognised(seen)
        return Belief.normalised(seen.log_p - share * self._trained_tilts)

    @cached_property
    def _trained_tilts(self) -> Float[np.ndarray, "37 21"]:
        """Log-probability of tilt, given the field of view, among the pictures of the training.

        A camera that looks down steeply is rare there, so the network takes one for less steep
        than it is; without this factor every tilt is as likely beforehand. Zeros where the file
        does not say.
        """
        text = self._session.get_modelmeta().custom_metadata_map.get(_TRAINED_TILTS)
        return np.zeros(SHAPE[1:]) if text is None else np.array(json.loads(text), np.float64)

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


class PoseReader:
    """Beliefs from pictures: the network's times the likelihood of their line segments.

    ``still``: the pictures are frames of one fixed camera, whose lines are looked for in some of
    them only and count in all. The network is loaded once, when the first picture is shown.
    """

    def __init__(self, network: OrientationNetwork | None = None, *, still: bool = False) -> None:
        self.network = OrientationNetwork() if network is None else network
        self._still = still
        self._shown = self._read = 0
        self._lines = np.zeros(SHAPE)

    def belief(self, image_bgr: np.ndarray) -> Belief:
        """What one picture (h, w, 3), 8-bit BGR, says about its camera.

        Network and lines each have their exponent; the less the network recognises, the less
        the lines count. Raises :class:`InputError` for a picture that is none, or smaller than 32
        pixels.
        """
        seen = self.network.belief(image_bgr)
        power = _LINE_POWER * _recognised(seen)
        return Belief.normalised(_NETWORK_POWER * seen.log_p + power * self._line_log_p(image_bgr))

    def _line_log_p(self, image_bgr: np.ndarray) -> Float[np.ndarray, "33 37 21"]:
        if not self._still:
            return line_log_likelihood(image_bgr)
        if self._shown < _FIRST_LINES or self._shown % _LINES_EVERY == 0:
            self._lines += line_log_likelihood(image_bgr)
            self._read += 1
        self._shown += 1
        return self._lines / self._read


def _recognised(seen: Belief) -> float:
    """Share of what has to be learned of a picture to take it for one that shows the world."""
    return min(1.0, seen.information() / _RECOGNISED_NATS)


def _prepared(image_bgr: np.ndarray) -> np.ndarray:
    require_bgr(image_bgr)
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
