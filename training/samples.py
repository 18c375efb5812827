"""Pictures with known cameras: a function of a seed. Nothing is stored."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from training.degrade import degraded
from training.layout import random_slope
from training.panoramas import CELLS, CROP_SIZE, WOODED, Panorama, View, crop, fields

Rng = np.random.Generator
STREET_SHARE = 0.45
"""Share of the samples that come from invented scenes."""
HOPELESS_SHARE = 0.03
"""Share of pictures that tell nothing: the network must say so."""
TURNED_SHARE = 0.04
"""Share of pictures that lie on their side or are upside down: no cell of the grid is theirs."""
HILL_SHARE = 0.5
"""Share of the samples of wooded places that are sheared into a hillside."""
COARSEST = 2.0
"""Pixels of a crop over one of its panorama, at most. Narrower crops of coarse panoramas would be
known by their blur."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What a sample teaches. ``hopeless``: nothing, but that nothing can be told."""

    view: View
    up_uv: np.ndarray
    latitude_rad: np.ndarray
    hopeless: bool


def sample_view(rng: Rng, panorama: Panorama, from_mast: bool) -> View:
    """A random camera, most of them as surveillance cameras are."""
    pixels_per_rad = panorama.levels[0].shape[1] / (2 * np.pi)
    while True:
        low, high = (15, 60) if rng.random() < 0.75 else (10, 100)
        vfov = np.radians(np.exp(rng.uniform(np.log(low), np.log(high))))
        if rng.random() < 0.6:
            tilt = np.radians(rng.uniform(2, 50) if from_mast else rng.uniform(0, 40))
        else:
            tilt = np.radians(rng.uniform(-15, 73))
        if CROP_SIZE[1] / vfov > COARSEST * pixels_per_rad:
            continue
        # A view of nothing but sky teaches little.
        if tilt + vfov / 2 <= panorama.lowest_rad and tilt + vfov / 2 > 0:
            break
    roll = rng.normal(0, 4) if rng.random() < 0.7 else rng.uniform(-20, 20)
    sloped = panorama.name in WOODED and rng.random() < HILL_SHARE
    return View(
        vfov_rad=float(vfov),
        tilt_rad=float(tilt),
        roll_rad=float(np.radians(np.clip(roll, -20, 20))),
        heading_rad=rng.uniform(0, 2 * np.pi),
        k1=float(rng.normal(0, 0.05)) if rng.random() < 0.3 else 0.0,
        mirrored=bool(rng.random() < 0.5),
        slope=random_slope(rng) if sloped else (0.0, 0.0),
    )


def sample(
    rng: Rng, photographs: Sequence[Panorama], streets: Sequence[Panorama], *, clean: bool = False
) -> tuple[np.ndarray, Truth]:
    """One picture (144, 192, 3) BGR uint8 and its truth; ``clean`` leaves it undegraded."""
    from_mast = bool(streets) and rng.random() < STREET_SHARE
    shelf = streets if from_mast else photographs
    panorama = shelf[rng.integers(len(shelf))]
    view = sample_view(rng, panorama, from_mast)
    kind = 1.0 if clean else rng.random()
    turned = kind < TURNED_SHARE
    if turned:
        turn = np.radians(rng.uniform(40, 180)) * rng.choice([-1, 1])
        view = replace(view, roll_rad=float(turn))
    # A mirrored world has mirrored cameras: the crop is turned over and its roll changes sign.
    seen = replace(view, roll_rad=-view.roll_rad)
    picture = crop(panorama, seen if view.mirrored else view)
    if view.mirrored:
        picture = np.ascontiguousarray(picture[:, ::-1])
    blank = not turned and kind < TURNED_SHARE + HOPELESS_SHARE
    if blank:
        picture = _hopeless(picture, rng)
    if not clean:
        picture = degraded(picture, rng)
    up_uv, latitude = fields(view, CELLS)
    return picture, Truth(view, up_uv, latitude, turned or blank)


def _hopeless(picture: np.ndarray, rng: Rng) -> np.ndarray:
    kind = rng.integers(4)
    height, width = picture.shape[:2]
    if kind == 0:
        return np.full_like(picture, rng.integers(256))
    if kind == 1:
        return rng.integers(0, 256, picture.shape).astype(np.uint8)
    if kind == 2:
        small = rng.uniform(0, 255, (2, 2, 3)).astype(np.float32)
        return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.uint8)
    return cv2.GaussianBlur(picture, (0, 0), 40)
