"""The ground of an invented scene, drawn from above in two scales."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from training.layout import Box, Layout
from training.panoramas import Panorama, View, crop

Rng = np.random.Generator
_FINE_M, _COARSE_M = 0.03, 0.24
_PIXELS = 2600


@dataclass(frozen=True, eq=False)
class GroundPicture:
    """Pictures from above, finest first, each with its metres a pixel; the camera's foot is in the
    middle, x to the right and y up.
    """

    levels: list[tuple[float, np.ndarray]]

    def levels_for(self, wanted_m: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Which level each of the wanted resolutions takes: pairs of a level and a mask."""
        sizes = np.array([metres for metres, _ in self.levels])
        taken = np.clip(np.searchsorted(sizes, wanted_m, side="right") - 1, 0, len(sizes) - 1)
        for level in np.unique(taken):
            yield int(level), taken == level

    def look_up(self, level: int, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Colours at points of the ground, the shape of ``x_m`` and three more."""
        metres, picture = self.levels[level]
        middle = picture.shape[0] / 2
        # The fine picture ends where the coarse one goes on.
        u, v = middle + x_m / metres, middle - y_m / metres
        out = cv2.remap(
            picture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT,
        ).astype(np.float32)  # fmt: skip
        outside = np.maximum(np.abs(x_m), np.abs(y_m)) > middle * metres
        coarser = next((n for n, (m, _) in enumerate(self.levels) if m >= _COARSE_M), None)
        if coarser is not None and level < coarser and outside.any():
            rest = self.look_up(coarser, x_m, y_m)
            out[outside] = rest[outside]
        return out


def draw_ground(layout: Layout, photographs: list[Panorama], rng: Rng) -> GroundPicture:
    """Draw twice, near and far, and halve each until the next begins."""
    style = int(rng.integers(1 << 30))
    texture = _texture(photographs, rng)
    levels = []
    for metres, until in ((_FINE_M, _COARSE_M), (_COARSE_M, 4.0)):
        picture = _draw(layout, metres, texture, np.random.default_rng(style))
        while metres < until * 0.9:
            levels.append((metres, picture))
            picture, metres = cv2.pyrDown(picture), metres * 2
    return GroundPicture(levels)


def _texture(photographs: list[Panorama], rng: Rng) -> np.ndarray:
    """Relative brightness of a patch of ground, repeating, (512, 512): photographed or noise."""
    if photographs and rng.random() < 0.5:
        panorama = photographs[rng.integers(len(photographs))]
        down = View(np.radians(75), np.radians(40), 0.0, rng.uniform(0, 2 * np.pi))
        grey = crop(panorama, down, (256, 256)).mean(axis=-1).astype(np.float32)
        patch = grey[128:] if rng.random() < 0.5 else grey[64:192]
        patch = cv2.resize(patch, (256, 256))
        patch = patch / np.maximum(cv2.GaussianBlur(patch, (0, 0), 40), 8)
        patch = np.vstack([patch, patch[::-1]])
        return np.clip(np.hstack([patch, patch[:, ::-1]]), 0.3, 2.0)
    out = np.ones((512, 512), np.float32)
    for size in (4, 16, 64, 256, 512):
        noise = rng.normal(0, 1, (size, size)).astype(np.float32)
        large = cv2.resize(noise, (512, 512), interpolation=cv2.INTER_CUBIC)
        out += rng.uniform(0.01, 0.07) * large
    return np.clip(out, 0.3, 2.0)


class _Pen:
    """Draws polygons given in metres along and across the scene's main axis."""

    def __init__(self, layout: Layout, metres: float, picture: np.ndarray):
        self.layout, self.metres, self.picture = layout, metres, picture

    def pixels(self, xy_m: np.ndarray) -> np.ndarray:
        middle = self.picture.shape[0] / 2
        uv = np.column_stack([middle + xy_m[:, 0] / self.metres, middle - xy_m[:, 1] / self.metres])
        return np.round(np.clip(uv, -8000, 8000) * 16).astype(np.int32)

    def band(self, along: tuple[float, float], across: tuple[float, float], colour) -> None:
        corners = np.array(
            [
                self.layout.place(a, b)
                for a, b in (
                    (along[0], across[0]),
                    (along[1], across[0]),
                    (along[1], across[1]),
                    (along[0], across[1]),
                )
            ]
        )
        self.fill(corners, colour)

    def fill(self, xy_m: np.ndarray, colour) -> None:
        colour = tuple(float(value) for value in np.broadcast_to(colour, 3))
        cv2.fillPoly(self.picture, [self.pixels(xy_m)], colour, cv2.LINE_AA, 4)


def _grey(rng: Rng, low: float, high: float) -> np.ndarray:
    return np.clip(rng.uniform(low, high) + rng.normal(0, 7, 3), 5, 250)


def _draw(layout: Layout, metres: float, texture: np.ndarray, rng: Rng) -> np.ndarray:
    lawn = np.array([45, 105, 85]) * rng.uniform(0.5, 1.4)
    open_ground = lawn if rng.random() < 0.35 or layout.kind == "lawn" else _grey(rng, 70, 190)
    picture = np.empty((_PIXELS, _PIXELS, 3), np.uint8)
    picture[:] = np.clip(open_ground, 0, 255)
    pen = _Pen(layout, metres, picture)
    far = _PIXELS * metres
    if layout.kind == "street":
        _street(pen, rng, far)
    elif layout.kind == "car park":
        _car_park(pen, rng, far)
    else:
        _square(pen, rng, far)
    _patches(pen, rng)
    side = max(8, round(rng.uniform(3, 14) / metres))
    tile = cv2.resize(texture, (side, side), interpolation=cv2.INTER_AREA)
    times = -(-_PIXELS // side)
    grain = 1 + rng.uniform(0.1, 0.7) * (np.tile(tile, (times, times))[:_PIXELS, :_PIXELS] - 1)
    light = _shadows(layout, metres, rng) if layout.sun is not None else np.float32(1)
    return np.clip(picture * (grain * light)[..., None], 0, 255).astype(np.uint8)


def _street(pen: _Pen, rng: Rng, far: float) -> None:
    near, wide = pen.layout.road_offset_m, pen.layout.road_width_m
    walk, paint = rng.uniform(1.2, 5), rng.uniform(150, 250)
    asphalt = _grey(rng, 45, 130)
    stones = _grey(rng, 90, 200)
    for low, high in ((near - walk, near), (near + wide, near + wide + walk)):
        pen.band((-far, far), (low, high), stones)
        _joints(pen, rng, far, low, high, stones * 0.75)
    pen.band((-far, far), (near, near + wide), asphalt)
    for edge in (near, near + wide):
        pen.band((-far, far), (edge - 0.12, edge + 0.12), _grey(rng, 120, 210))
    if rng.random() < 0.5:
        start = rng.uniform(-25, 25)
        pen.band((start, start + rng.uniform(5, 9)), (-far, far), asphalt)
    lanes = int(max(2, wide // 3.2))
    dash, gap = rng.uniform(1.5, 5), rng.uniform(2, 7)
    for lane in range(1, lanes):
        across = near + wide * lane / lanes
        if rng.random() < 0.3:
            pen.band((-far, far), (across - 0.07, across + 0.07), paint)
            continue
        for along in np.arange(-90, 90, dash + gap):
            pen.band((along, along + dash), (across - 0.08, across + 0.08), paint)
    if rng.random() < 0.45:
        start, stripe = rng.uniform(-20, 20), rng.uniform(0.4, 0.7)
        for across in np.arange(near + 0.3, near + wide - 0.3, 2 * stripe):
            pen.band((start, start + rng.uniform(2.5, 4)), (across, across + stripe), paint)


def _joints(pen: _Pen, rng: Rng, far: float, low: float, high: float, colour: np.ndarray) -> None:
    if pen.metres > 0.1:
        return
    size = rng.uniform(0.4, 1.5)
    for along in np.arange(-38, 38, size):
        pen.band((along, along + 0.035), (low, high), colour)
    for across in np.arange(low, high, size):
        pen.band((-far, far), (across, across + 0.035), colour)


def _car_park(pen: _Pen, rng: Rng, far: float) -> None:
    pen.band((-60, 60), (-60, 60), _grey(rng, 55, 140))
    pitch, gap, paint = rng.uniform(2.4, 2.9), rng.uniform(14, 18), rng.uniform(150, 250)
    for row in range(-3, 4):
        middle = row * gap + pen.layout.road_offset_m
        pen.band((-18 * pitch, 18 * pitch), (middle - 0.06, middle + 0.06), paint)
        for stall in range(-18, 19):
            along = (stall + 0.5) * pitch
            pen.band((along, along + 0.11), (middle - 5, middle + 5), paint)


def _square(pen: _Pen, rng: Rng, far: float) -> None:
    for _ in range(rng.integers(0, 4)):
        across = rng.uniform(-25, 25)
        half = rng.uniform(0.5, 4)
        pen.band((-far, far), (across - half, across + half), _grey(rng, 80, 210))
        if rng.random() < 0.5:
            along = rng.uniform(-25, 25)
            pen.band((along - half, along + half), (-far, far), _grey(rng, 80, 210))
    if rng.random() < 0.65:
        size, colour = rng.uniform(0.6, 5), _grey(rng, 50, 200)
        thick = rng.uniform(0.03, 0.12)
        for line in np.arange(-38, 38, size):
            pen.band((line, line + thick), (-38, 38), colour)
            pen.band((-38, 38), (line, line + thick), colour)


def _patches(pen: _Pen, rng: Rng) -> None:
    """Repairs, manholes, stains."""
    for _ in range(rng.integers(0, 30)):
        x, y, half = rng.uniform(-30, 30), rng.uniform(-30, 30), rng.uniform(0.2, 2.5)
        turns = np.linspace(0, 2 * np.pi, int(rng.choice([5, 17])))[:-1] + pen.layout.axis_rad
        ring = np.column_stack([x + half * np.cos(turns), y + half * np.sin(turns)])
        pen.fill(ring, _grey(rng, 40, 190))


def _shadows(layout: Layout, metres: float, rng: Rng) -> np.ndarray:
    light = np.ones((_PIXELS, _PIXELS), np.float32)
    pen = _Pen(layout, metres, light)
    dark = rng.uniform(0.35, 0.75)
    for box in layout.boxes:
        hull = cv2.convexHull(_shadow(box, layout.sun).astype(np.float32))[:, 0]
        cv2.fillPoly(light, [pen.pixels(hull)], dark, cv2.LINE_AA, 4)
    for ball in layout.balls:
        reach = layout.sun[:2] / layout.sun[2]
        turns = np.linspace(0, 2 * np.pi, 24)
        ring = ball.radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
        spot = np.array([ball.x_m, ball.y_m]) - reach * ball.z_m
        cv2.fillPoly(light, [pen.pixels(ring + spot)], dark, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(light, (0, 0), max(0.6, 0.05 / metres))


def _shadow(box: Box, sun: np.ndarray) -> np.ndarray:
    """Corners of the shadow on the ground, (8, 2)."""
    reach = sun[:2] / sun[2]
    foot = box.footprint()
    return np.vstack([foot - reach * box.bottom_m, foot - reach * box.top_m])
