"""Who is as modelled, who is seen too short, and who is no person: a mixture over log length and
direction (:mod:`._refine`).
"""

import numpy as np

from scene4d.calibration._problem import Noise

# Chosen by hand on PETS 2009 and TownCentre, like the rest of the noise (:mod:`._refine`).
SHORT_RANGE, TURN_RANGE = 1.2, 0.8
"""Range of log length (legs hidden down to 30 % of a person: -ln 0.3) and of direction (radians,
46°: more than anybody leans) of outliers."""
_SHORT_FROM, _SHORT_EDGE = 1.0, 0.5
"""Where "too short" begins and how softly, in sigmas: earlier it would take people as modelled."""


def mixture(
    residual: np.ndarray, valid: np.ndarray, along: np.ndarray, across: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Per person: probability of being as modelled, of being upright, the push of the soft edge
    of "too short" on a, and ``-2 log p``.

    People whose prediction is invalid are strays: no camera may win by losing people.
    """
    a = np.where(valid, np.clip(residual[0], -1e3, 1e3), -1e3)
    upright = np.exp(-0.5 * np.where(valid, residual[1] ** 2, 1e6))
    edge = 1 / (1 + np.exp(np.clip((_SHORT_FROM - a) / _SHORT_EDGE, -40.0, 40.0)))  # logistic step
    flat_a = along * np.sqrt(2 * np.pi) / SHORT_RANGE
    flat_c = across * np.sqrt(2 * np.pi) / TURN_RANGE
    modelled = (1 - noise.short - noise.stray) * np.exp(-0.5 * a * a) * upright
    short = noise.short * flat_a * edge * upright
    total = modelled + short + noise.stray * flat_a * flat_c
    inlier, too_short = modelled / total, short / total
    push = np.where(valid, too_short * (1 - edge) / _SHORT_EDGE, 0.0)
    return inlier, inlier + too_short, push, -2 * np.log(total)
