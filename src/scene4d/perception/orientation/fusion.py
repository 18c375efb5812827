"""Many frames of one fixed camera to one belief."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from scene4d.perception.orientation.grid import Belief

_CORRELATION = 0.9
"""Of the network's errors in two frames of one camera: it looks at the same scene."""
_STRAY_SIGMAS = 4.0
_MAD_TO_SIGMA = 1.4826


def fused(beliefs: Sequence[Belief], *, correlation: float = _CORRELATION) -> Belief:
    """The mean log-probability of the frames, raised to how many of them count.

    Of n equally correlated frames ``n / (1 + (n - 1) · correlation)`` count. Frames that stray from
    the median of all (a lorry before the lens, a blinded sensor) are left out. An even belief for
    no frames.
    """
    if not beliefs:
        return Belief.even()
    kept = [belief for belief, stray in zip(beliefs, _strays(beliefs), strict=True) if not stray]
    total = np.zeros_like(beliefs[0].log_p)
    for belief in kept:
        total += belief.log_p
    effective = len(kept) / (1 + (len(kept) - 1) * correlation)
    return Belief.normalised(total * (effective / len(kept)))


def _strays(beliefs: Sequence[Belief]) -> np.ndarray:
    """Which frames read a value far from the median, for their own spread and that of all."""
    mean = np.array([belief.mean() for belief in beliefs])
    sigma = np.array([belief.sigma() for belief in beliefs])
    apart = np.abs(mean - np.median(mean, axis=0))
    common = _MAD_TO_SIGMA * np.median(apart, axis=0)
    stray: np.ndarray = (apart > _STRAY_SIGMAS * np.hypot(sigma, common)).any(axis=1)
    return stray if not stray.all() else np.zeros(len(beliefs), bool)


def modal(beliefs: Sequence[Belief]) -> np.ndarray:
    """Roll, tilt and field of view (radians) read most often, as the paper takes them: the mode
    over frames of each frame's likeliest cell, the first of several. Raises :class:`ValueError` for
    no frames.
    """
    if not beliefs:
        raise ValueError("the mode of no frames")
    votes = Counter(tuple(belief.mode()) for belief in beliefs)
    return np.array(votes.most_common(1)[0][0])
