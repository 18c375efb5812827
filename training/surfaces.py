"""Colours of boxes: facades with windows, cars, walls."""

import numpy as np

from training.layout import Box, Layout

_NOISE = np.random.default_rng(7).normal(size=(256, 256)).astype(np.float32)


def box_colour(
    box: Box, axis: np.ndarray, side: np.ndarray, point: np.ndarray, layout: Layout
) -> np.ndarray:
    """Colour (n, 3) of points (3, n) in the box's frame, on its faces ``axis`` and ``side``."""
    along = np.where(axis == 0, point[1], point[0])
    height = point[2] + (box.top_m - box.bottom_m) / 2
    colour = np.repeat(box.colour[None], len(axis), axis=0).astype(np.float32)
    upright = axis != 2
    if box.surface == "facade":
        _facade(box, colour, along + 37.0 * axis, height, upright)
    elif box.surface == "cabin":
        glass = upright & (height > 0.08) & (height < 0.52)
        colour[glass] = 25 + 0.12 * colour[glass]
    elif box.surface == "car":
        wheel = (axis == 1) & (np.abs(np.abs(point[0]) - 0.62 * box.half_x_m) < 0.32)
        colour[wheel & (height < 0.5)] = 22
        lamp = (axis == 0) & (np.abs(point[1]) > 0.6 * box.half_y_m) & (height > 0.35)
        colour[lamp] = np.where(box.seed % 2, [60.0, 60.0, 220.0], [230.0, 235.0, 235.0])
    elif box.surface == "wall":
        joint = ((height % 0.3) < 0.04) & upright
        colour[joint] *= 0.7
    _roughen(colour, along, height, box.seed, 0.03 if box.surface in ("car", "cabin") else 0.08)
    return colour * _light(box, axis, side, layout)[:, None]


def _facade(
    box: Box, colour: np.ndarray, along: np.ndarray, height: np.ndarray, upright: np.ndarray
) -> None:
    rng = np.random.default_rng(box.seed)
    pitch, floor = rng.uniform(1.2, 5), rng.uniform(2.7, 3.8)
    wide, tall = rng.uniform(0.3, 0.85), rng.uniform(0.35, 0.75)
    column, across = np.divmod(along, pitch)
    storey, above = np.divmod(height, floor)
    window = (np.abs(across / pitch - 0.5) < wide / 2) & (np.abs(above / floor - 0.55) < tall / 2)
    window &= upright
    pane = ((column * 73 + storey * 179 + box.seed) % 97) / 97
    colour[window] = (25 + 90 * pane[window, None]) * rng.uniform(0.7, 1.2, 3)
    band = upright & (above < 0.18)
    if rng.random() < 0.5:
        colour[band] *= rng.uniform(0.6, 1.3)
    if rng.random() < 0.4:
        colour[upright & ((height % 0.25) < 0.03) & ~window] *= 0.85
    if rng.random() < 0.3:
        ground_floor = upright & (height < floor) & (np.abs(across / pitch - 0.5) < 0.45)
        colour[ground_floor] = rng.uniform(20, 120, 3)


def _roughen(
    colour: np.ndarray, along: np.ndarray, height: np.ndarray, seed: int, amount: float
) -> None:
    coarse = _NOISE[(height * 2.3).astype(int) % 256, (along * 2.3 + seed % 251).astype(int) % 256]
    fine = _NOISE[(height * 19).astype(int) % 256, (along * 19 + seed % 241).astype(int) % 256]
    colour *= (1 + amount * (coarse + fine))[:, None]


def _light(box: Box, axis: np.ndarray, side: np.ndarray, layout: Layout) -> np.ndarray:
    """Lambert's law, with a sky that is brighter above."""
    faces = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    to_world = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    normal = side[:, None] * (faces @ to_world.T)[axis]
    sky = 0.62 + 0.25 * normal[:, 2]
    if layout.sun is None:
        return (sky + 0.12).astype(np.float32)
    return (sky * 0.75 + 0.6 * np.clip(normal @ layout.sun, 0, 1)).astype(np.float32)
