"""The classical reading of a picture's orientation: straight edges and their vanishing points.

A camera of roll, tilt and field of view says where in the image all uprights of the world meet,
and on which line the horizontals do. In towns two horizontal directions at right angles prevail
(Coughlan and Yuille, "Manhattan World", 1999); their heading is unknown and summed over. Each
image segment is upright, or follows one of these two, or follows nothing and points anywhere.
Horizontals of other headings are among the last: every line of an image meets the horizon.

How well a segment fits a vanishing point depends on the point's place in the image alone. So the
fit to a table of places is computed once, and every cell of the grid reads it where its vanishing
points fall. First kind by kind, as if no segment could fit two of the points: the sum over
headings is then one of sums that are known. Segments that do fit two points make narrow fields
of view look better than they are, so the likeliest cells are read again with the mixture itself.
"""

import functools
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from scene4d.perception.lines import straight_edges
from scene4d.perception.orientation.grid import (
    ROLL_RAD,
    SHAPE,
    TILT_RAD,
    VFOV_RAD,
    centre_crop,
)

_WORKING_HEIGHT = 480
"""Larger pictures are shrunk to this height: finding segments takes half of the time."""
LONGEST = 120
"""So many segments are used, the longest."""

# Tuned by hand on crops of panoramas (files happy358_* and gkjohnson_* only).
_UPRIGHT_SHARE = np.float32(0.4)
_HORIZONTAL_SHARE = np.float32(0.1)
"""Of each of the two horizontal directions. Few, because many places have more than two."""
_ANGLE_SIGMA_RAD = np.radians(0.6)
"""How far real edges stray from the three directions."""
_END_SIGMA_PX = 0.4
"""Error of a segment's end, across the segment."""
_PLACE_SIGMA_RAD = np.radians(0.4)
"""Blur of a vanishing point: the cells of the table have a size."""
_FULL_LENGTH = 0.5
"""A segment of this length (half heights of the picture) counts once, a shorter one in part."""
_INDEPENDENT = 25.0
"""Segments of one window or house err together: however many there are, no more are believed."""

# The table of places: polar angle from the image's centre, as seen from half a height away, and
# azimuth. A turn of the camera about its axis shifts the azimuth, by whole cells from roll to roll.
_POLAR_RAD = np.linspace(0, np.pi / 2, 91)
_AZIMUTH_STEP = ROLL_RAD[1] - ROLL_RAD[0]
_AZIMUTHS = round(2 * np.pi / _AZIMUTH_STEP)
_LEVEL = len(ROLL_RAD) // 2

_SAMPLES = 6
"""Cameras that stand for one cell of the grid: within it, vanishing points move far."""
_HEADINGS = 12
"""Headings of the first horizontal direction, over a right angle; the second follows it."""
_GOLDEN = (np.sqrt(5) - 1) / 2
_AGAIN = 1_000_000
"""Fits read again: for so many divided by the segments, the likeliest cells."""


class _Readings(NamedTuple):
    """Places where the vanishing points of every cell's sample cameras fall, at roll 0."""

    upright: Int[np.ndarray, "1 samples 37 21"]
    first: Int[np.ndarray, "headings samples 37 21"]
    second: Int[np.ndarray, "headings samples 37 21"]


def line_log_likelihood(image_bgr: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "33 37 21"]:
    """Log-likelihood, up to a constant, of every cell of the grid given a picture's edges.

    Axes as :class:`.grid.Belief`; the principal point is the picture's centre, pixels are square,
    the lens is straight. Zeros where there are no edges: every cell is then as likely. Raises
    :class:`InputError` for a picture of which no 4:3 crop is left.
    """
    crop = centre_crop(image_bgr)
    height, width = crop.shape[:2]
    if height > _WORKING_HEIGHT:
        width, height = round(width * _WORKING_HEIGHT / height), _WORKING_HEIGHT
        crop = cv2.resize(crop, (width, height), interpolation=cv2.INTER_AREA)
    return segment_log_likelihood(straight_edges(crop), (width, height))


def segment_log_likelihood(
    segments_xyxy: Float[np.ndarray, "n 4"], crop_size: tuple[int, int]
) -> Float[np.ndarray, "33 37 21"]:
    """As :func:`line_log_likelihood`, from segments' end points in pixels of the 4:3 crop.

    ``crop_size`` is (width, height); pixel centres are at integers. The log-likelihood is
    tempered: segments of one object err together (``_INDEPENDENT``).
    """
    width, height = crop_size
    ends = (segments_xyxy.reshape(-1, 2, 2) - [(width - 1) / 2, (height - 1) / 2]) / (height / 2)
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    longest = np.argsort(-length, kind="stable")[:LONGEST]
    longest = longest[length[longest] > 0]
    if len(longest) == 0:
        return np.zeros(SHAPE)
    weight = np.minimum(1.0, length[longest] / _FULL_LENGTH)
    weight /= 1 + weight.sum() / _INDEPENDENT
    gain = _gains(ends[longest], _END_SIGMA_PX / (height / 2))
    return _log_likelihood(gain, weight.astype(np.float32))


def _gains(ends: Float[np.ndarray, "n 2 2"], end_sigma: float) -> Float32[np.ndarray, "p n"]:
    """Density of every segment's direction given a vanishing point at each place, over that of a
    segment that points anywhere, less one.

    With a vanishing point v (homogeneous, unit), a segment's line l (unit normal) and middle m,
    the segment misses v by an angle of sine l·v / ‖v_xy - m v_z‖. On the circle of directions
    the density is ∝ (1 + k sin²)⁻², a Student's t with three degrees of freedom when it is narrow
    and flat when it is wide; normalised, so that places near segments' middles are not favoured.
    """
    middle, span = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.hypot(*span.T)
    normal = np.column_stack([-span[:, 1], span[:, 0]]) / length[:, None]
    variance = (_ANGLE_SIGMA_RAD**2 + 2 * (end_sigma / length) ** 2).astype(np.float32)
    blur = np.float32(_PLACE_SIGMA_RAD**2)
    azimuth = np.arange(_AZIMUTHS) * _AZIMUTH_STEP
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    across, along = (around @ normal.T).astype(np.float32), (around @ middle.T).astype(np.float32)
    offset = (normal * middle).sum(axis=1).astype(np.float32)
    reach = (middle * middle).sum(axis=1).astype(np.float32)

    gain = np.empty((len(_POLAR_RAD), _AZIMUTHS, len(ends)), np.float32)
    # Row by row: what the loop works on stays in the processor's cache.
    for row, polar in enumerate(_POLAR_RAD):
        s, c = np.float32(np.sin(polar)), np.float32(np.cos(polar))
        miss = s * across - c * offset
        distance = np.maximum(s * s - (2 * s * c) * along + c * c * reach, 0)
        width = 2 * (variance * distance + blur)
        peak = (width + distance) * width
        peak *= np.sqrt(peak)
        gain[row] = 2 * peak / ((2 * width + distance) * np.square(width + miss * miss)) - 1
    return gain.reshape(-1, len(ends))


def _log_likelihood(
    gain: Float32[np.ndarray, "p n"], weight: Float32[np.ndarray, "n"]
) -> Float[np.ndarray, "33 37 21"]:
    upright = _alone(gain, _UPRIGHT_SHARE) @ weight
    horizontal = _alone(gain, _HORIZONTAL_SHARE) @ weight
    rough, camera = _read(upright, horizontal)
    again = np.argsort(-rough, axis=None)[: _AGAIN // len(weight)]
    top, first, second = _places(camera, again)
    mixture = 1 + _UPRIGHT_SHARE * gain[top] + _HORIZONTAL_SHARE * (gain[first] + gain[second])
    # Never near zero: the rest of the mixture points anywhere, so no segment rules a camera out.
    exact = np.log(mixture) @ weight
    change = exact - (upright[top] + horizontal[first] + horizontal[second])
    out = rough.ravel() + change.mean()
    out[again] = rough.ravel()[again] + change
    return out.reshape(SHAPE)


def _alone(gain: np.ndarray, share: np.float32) -> np.ndarray:
    mixture = gain * share
    mixture += 1
    return np.log(mixture, out=mixture)


def _read(
    upright: Float32[np.ndarray, "p"], horizontal: Float32[np.ndarray, "p"]
) -> tuple[Float[np.ndarray, "33 37 21"], Int[np.ndarray, "33 37 21"]]:
    """Mean likelihood of every cell's sample cameras, kind by kind, and the likeliest of them."""
    at = _readings()
    out, likeliest = np.empty(SHAPE), np.empty(SHAPE, int)
    for i in range(len(ROLL_RAD)):
        upright_i, horizontal_i = (
            np.roll(table.reshape(-1, _AZIMUTHS), _LEVEL - i, axis=1)
            for table in (upright, horizontal)
        )
        total = horizontal_i.take(at.first) + horizontal_i.take(at.second)
        total += upright_i.take(at.upright)
        total = total.reshape(-1, *SHAPE[1:])
        best = total.max(axis=0)
        likeliest[i] = total.argmax(axis=0)
        out[i] = best + np.log(np.exp(total - best).mean(axis=0))
    return out, likeliest


def _places(
    camera: Int[np.ndarray, "33 37 21"], cells: Int[np.ndarray, "k"]
) -> list[Int[np.ndarray, "k"]]:
    """Places of the three vanishing points of these cells' chosen sample cameras."""
    roll, tilt, vfov = np.unravel_index(cells, SHAPE)
    heading, sample = np.divmod(camera.ravel()[cells], _SAMPLES)
    places = []
    for table in _readings():
        # Uprights have no heading.
        polar, azimuth = np.divmod(table[heading % len(table), sample, tilt, vfov], _AZIMUTHS)
        places.append(polar * _AZIMUTHS + (azimuth + roll - _LEVEL) % _AZIMUTHS)
    return places


@functools.cache
def _readings() -> _Readings:
    """The sample cameras are a lattice over the cell, each with headings of its own."""
    sample = np.arange(_SAMPLES)[:, None, None]
    tilt = TILT_RAD[:, None] + (TILT_RAD[1] - TILT_RAD[0]) * ((sample + 0.5) / _SAMPLES - 0.5)
    vfov = VFOV_RAD * (VFOV_RAD[1] / VFOV_RAD[0]) ** ((sample + 0.5) * _GOLDEN % 1 - 0.5)
    turn = (np.arange(_HEADINGS)[:, None, None, None] + (sample + 0.5) / _SAMPLES) / _HEADINGS
    heading = turn * np.pi / 2
    f = 1 / np.tan(vfov / 2)

    def ahead(angle: np.ndarray) -> np.ndarray:
        # Columns of R: cos(heading) X + sin(heading) Y, in half heights of the picture.
        return _place(
            *np.broadcast_arrays(
                f * np.cos(angle), -f * np.sin(angle) * np.sin(tilt), np.sin(angle) * np.cos(tilt)
            )
        )

    upright = _place(0 * f * tilt, f * np.cos(tilt), 0 * f + np.sin(tilt))
    return _Readings(upright[None], ahead(heading), ahead(heading + np.pi / 2))


def _place(
    x: Float[np.ndarray, "*shape"], y: Float[np.ndarray, "*shape"], z: Float[np.ndarray, "*shape"]
) -> Int[np.ndarray, "*shape"]:
    """Cell of the table of the homogeneous image point (x, y, z), which is that of (-x, -y, -z)."""
    sign = np.where(z < 0, -1, 1)
    polar = np.arctan2(np.hypot(x, y), np.abs(z)) / (_POLAR_RAD[1] - _POLAR_RAD[0])
    azimuth = np.arctan2(sign * y, sign * x) / _AZIMUTH_STEP
    return np.rint(polar).astype(int) * _AZIMUTHS + np.rint(azimuth).astype(int) % _AZIMUTHS
