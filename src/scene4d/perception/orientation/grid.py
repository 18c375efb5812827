"""Beliefs about roll, tilt and vertical field of view on one fixed grid, and their fusion."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation

ROLL_RAD = np.radians(np.arange(-24.0, 24.1, 1.5))
"""Roll of the cells' centres, (33,)."""
TILT_RAD = np.radians(np.arange(-17.5, 72.6, 2.5))
"""Tilt below the horizon of the cells' centres, (37,)."""
VFOV_RAD = np.radians(np.geomspace(9.0, 110.0, 21))
"""Vertical field of view of the cells' centres, (21,): equal steps of its logarithm."""
SHAPE = (len(ROLL_RAD), len(TILT_RAD), len(VFOV_RAD))
ASPECT = (4, 3)
"""Width to height of the centred crop that is looked at."""
_MOST_CORRELATION = 0.98
"""Of focal length and tilt: a covariance must stay invertible."""
_AXES = (ROLL_RAD, TILT_RAD, np.log(VFOV_RAD))
_STEPS = np.array([axis[1] - axis[0] for axis in _AXES])
_EVEN_VARIANCE = 1 / 12
"""Of an even distribution over a cell one wide: what is known of the place within a cell."""
_NEAR = np.array(list(np.ndindex(3, 3, 3))) - 1
"""Steps from a cell to itself and to the 26 that touch it."""
_PAIRS = np.triu_indices(3)
_TERMS = np.column_stack([np.ones(len(_NEAR)), _NEAR, _NEAR[:, _PAIRS[0]] * _NEAR[:, _PAIRS[1]]])
"""Of a quadratic at those steps."""
_CORRELATION = 0.9
"""Of the network's errors in two frames of one camera: it looks at the same scene. Chosen
by hand."""
_STRAY_SIGMAS = 4.0
"""A frame that reads a value so far from the median of all is left out; chosen by hand."""
_MAD_TO_SIGMA = 1.4826  # of a Gaussian


def crop_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Width and height in pixels of the largest centred 4:3 crop of a picture.

    The field of view of everything here is that crop's, which depends on nothing that lies outside
    of it. Raises :class:`InputError` where nothing would be left.
    """
    width, height = image_size
    across, along = ASPECT
    size = min(width, height * across // along), min(height, width * along // across)
    if min(size) < 1:
        raise InputError(f"the picture of {width}x{height} pixels is too small to read a camera in")
    return size


def centre_crop(image_bgr: np.ndarray) -> np.ndarray:
    """The largest centred 4:3 part of a picture (h, w, 3), a view of it."""
    height, width = image_bgr.shape[:2]
    across, along = crop_size((width, height))
    left, top = (width - across) // 2, (height - along) // 2
    return image_bgr[top : top + along, left : left + across]


@dataclass(frozen=True, eq=False)
class Belief:
    """Log-probability of every cell of the grid, normalised to sum to one.

    ``log_p`` has the axes roll, tilt and vertical field of view (of :func:`crop_size`).
    """

    log_p: Float[np.ndarray, "33 37 21"]

    @classmethod
    def normalised(cls, log_weight: Float[np.ndarray, "33 37 21"]) -> "Belief":
        """From unnormalised log-weights."""
        shifted = log_weight - log_weight.max()
        return cls(shifted - np.log(np.exp(shifted).sum()))

    @classmethod
    def even(cls) -> "Belief":
        """Every cell is as likely."""
        return cls.normalised(np.zeros(SHAPE))

    @classmethod
    def gaussian(cls, mean: tuple[float, ...], sigma: tuple[float, ...]) -> "Belief":
        """Independent Gaussians of roll, tilt and the logarithm of the field of view."""
        roll, tilt, log_vfov = (
            -0.5 * ((nodes - middle) / spread) ** 2
            for nodes, middle, spread in zip(_AXES, mean, sigma, strict=True)
        )
        return cls.normalised(roll[:, None, None] + tilt[:, None] + log_vfov)

    @cached_property
    def p(self) -> Float[np.ndarray, "33 37 21"]:
        """Probability of every cell."""
        return np.exp(self.log_p)

    def marginal(self, axis: int) -> Float[np.ndarray, "n"]:
        """Probability over one axis: 0 roll, 1 tilt, 2 vertical field of view."""
        return np.asarray(self.p.sum(axis=tuple(other for other in range(3) if other != axis)))

    def mean(self) -> Float[np.ndarray, "3"]:
        """Expected roll and tilt, and the field of view of the expected logarithm; radians."""
        roll, tilt, log_vfov = (self.marginal(n) @ axis for n, axis in enumerate(_AXES))
        return np.array([roll, tilt, np.exp(log_vfov)])

    def sigma(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of roll, tilt and field of view, radians.

        A cell's probability is spread evenly over it, as in :meth:`interval`, so none is narrower
        than a cell's own.
        """
        spread = [
            np.sqrt(_variance(self.marginal(n), nodes) + _EVEN_VARIANCE * _STEPS[n] ** 2)
            for n, nodes in enumerate(_AXES)
        ]
        return np.array(spread) * [1, 1, self.mean()[2]]

    def information(self) -> float:
        """How much is known: nats by which the entropy is below that of an even distribution."""
        terms = np.where(self.p > 0, self.p * self.log_p, 0.0)
        return float(np.log(self.p.size) + terms.sum())

    def log_density_at(self, roll_rad: float, tilt_rad: float, vfov_rad: float) -> float:
        """Log-probability of the cell that holds these values; the outermost cells have no end."""
        at = tuple(
            int(np.abs(nodes - value).argmin())
            for value, nodes in zip((roll_rad, tilt_rad, np.log(vfov_rad)), _AXES, strict=True)
        )
        return float(self.log_p[at])

    def mode(self) -> Float[np.ndarray, "3"]:
        """Roll, tilt and field of view of the likeliest cell, radians."""
        at = np.unravel_index(np.argmax(self.log_p), SHAPE)
        return np.array([ROLL_RAD[at[0]], TILT_RAD[at[1]], VFOV_RAD[at[2]]])

    def interval(self, axis: int, share: float = 0.95) -> tuple[float, float]:
        """The central interval of one axis with this probability, radians."""
        nodes, step = _AXES[axis], _STEPS[axis]
        # A cell's probability is spread evenly over it.
        edges = np.append(nodes - step / 2, nodes[-1] + step / 2)
        reached = np.concatenate([[0.0], np.cumsum(self.marginal(axis))])
        ends = np.interp([(1 - share) / 2, (1 + share) / 2], reached / reached[-1], edges)
        low, high = np.exp(ends) if axis == 2 else ends
        return float(low), float(high)

    def given_vfov(self, vfov_rad: float, relative_sigma: float = 0.02) -> "Belief":
        """With the field of view known from a lens, which makes tilt and roll sharper.

        Raises :class:`InputError` for a field of view that is none.
        """
        if not 0 < vfov_rad < np.pi:
            raise InputError(f"vfov_rad must lie in 0 to π, found {vfov_rad}")
        log_vfov = np.log(np.clip(vfov_rad, VFOV_RAD[0], VFOV_RAD[-1]))
        # Never narrower than the grid can hold.
        spread = max(relative_sigma, _STEPS[2] / 2)
        weight = -0.5 * ((_AXES[2] - log_vfov) / spread) ** 2
        return Belief.normalised(self.log_p + weight)

    def orientation(self, image_size: tuple[int, int]) -> Orientation:
        """As a Gaussian over focal length in pixels, tilt and roll of pictures of this size."""
        log_focal = np.log(crop_size(image_size)[1] / 2 / np.tan(VFOV_RAD / 2))
        weight = self.marginal(2)
        focal = float(weight @ log_focal)
        # d log f / d log vfov = -vfov / sin(vfov)
        within = _EVEN_VARIANCE * (_STEPS[2] * VFOV_RAD / np.sin(VFOV_RAD)) ** 2
        focal_sigma = float(np.sqrt(_variance(weight, log_focal) + weight @ within))
        (roll, tilt, _), (roll_sigma, tilt_sigma, _) = self.mean(), self.sigma()
        together = (TILT_RAD - tilt) @ self.p.sum(axis=0) @ (log_focal - focal)
        correlation = float(together / (tilt_sigma * focal_sigma))
        return Orientation(
            focal_px=float(np.exp(focal)),
            tilt_rad=float(tilt),
            roll_rad=float(roll),
            focal_sigma_px=float(np.exp(focal)) * focal_sigma,
            tilt_sigma_rad=float(tilt_sigma),
            roll_sigma_rad=float(roll_sigma),
            focal_tilt_correlation=float(
                np.clip(correlation, -_MOST_CORRELATION, _MOST_CORRELATION)
            ),
        )

    def peak(self, cell: tuple[int, ...]) -> Float[np.ndarray, "3"]:
        """Roll, tilt and field of view (radians) of the peak near a cell, between the grid's nodes.

        A quadratic, as the logarithm of a Gaussian is, is fitted to the log-probability of the cell
        and of those that touch it. The peak is never farther than one cell; where there is none, it
        is the cell's centre.
        """
        inner = np.clip(cell, 1, np.array(SHAPE) - 2)
        heights = self.log_p[tuple((inner + _NEAR).T)]
        heights = heights - heights.max()
        weight = np.exp(heights / 2)  # squares weighted by probability
        quadratic, *_ = np.linalg.lstsq(weight[:, None] * _TERMS, weight * heights, rcond=None)
        slope, bend = quadratic[1:4], np.zeros((3, 3))
        bend[_PAIRS] = quadratic[4:]
        bend += bend.T
        step = np.zeros(3)
        if np.linalg.eigvalsh(bend).max() < 0:
            step = inner - cell + np.linalg.solve(-bend, slope)
        nodes = np.array([axis[n] for axis, n in zip(_AXES, cell, strict=True)])
        roll, tilt, log_vfov = nodes + np.clip(step, -1, 1) * _STEPS
        return np.array([roll, tilt, np.exp(log_vfov)])


def _variance(weight: Float[np.ndarray, "n"], values: Float[np.ndarray, "n"]) -> float:
    return float(weight @ (values - weight @ values) ** 2)


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
    """Roll, tilt and field of view (radians) read most often, as the paper takes them.

    The mode over frames of each frame's likeliest cell. Within it and towards its neighbours, the
    place is that of the peak of what all frames say together (:meth:`Belief.peak`): whether a
    camera's tilt lies at the middle of a cell or between two is luck. Of cells read equally often,
    the likeliest. Raises :class:`ValueError` for no frames.
    """
    if not beliefs:
        raise ValueError("the mode of no frames")
    together = fused(beliefs)
    votes = Counter(int(np.argmax(belief.log_p)) for belief in beliefs)
    cell = max(votes, key=lambda cell: (votes[cell], together.log_p.flat[cell]))
    return together.peak(tuple(int(n) for n in np.unravel_index(cell, SHAPE)))
