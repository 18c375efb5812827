"""All that one picture says about its camera: the network's reading, and straight lines."""

import numpy as np

from scene4d.perception.orientation.grid import Belief
from scene4d.perception.orientation.lines import line_log_likelihood
from scene4d.perception.orientation.network import OrientationNetwork

_NETWORK_POWER = 0.9
_LINE_POWER = 0.75
"""Exponents of the two, with the best log score together on the validation panoramas
(``python -m training.card --fit``). Below one: each is a little too sure, and lines repeat one
another; and what one of them sees, the other partly sees as well."""
_RECOGNISED_NATS = 3.0
"""Lines count in full where the network has learned this much (three in four validation crops), and
not at all where it has learned nothing: a picture on its side is full of good lines that lie."""


class PoseReader:
    """What pictures say. The network is loaded once, when the first picture is shown."""

    def __init__(self, network: OrientationNetwork | None = None) -> None:
        self.network = OrientationNetwork() if network is None else network

    def belief(self, image_bgr: np.ndarray) -> Belief:
        """What one picture (h, w, 3), 8-bit BGR, says about its camera.

        The network's belief times the likelihood of the picture's line segments, each to its
        exponent; the less the network recognises, the less the lines are asked. Raises
        :class:`InputError` for a picture that is none, or smaller than 32 pixels.
        """
        read = self.network.belief(image_bgr)
        lines = _LINE_POWER * min(1.0, read.information() / _RECOGNISED_NATS)
        return Belief.normalised(
            _NETWORK_POWER * read.log_p + lines * line_log_likelihood(image_bgr)
        )
