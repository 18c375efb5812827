"""Panoramas of invented streets, car parks and squares, seen from a camera's mast.

Photographed panoramas stand at head height; surveillance cameras do not. A scene is a textured
ground, drawn from above, and boxes and balls on it, cast ray by ray into an equirectangular
picture, so that crops of it are as exact as crops of a photograph.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from training.ground import GroundPicture, draw_ground
from training.layout import Ball, Box, Layout, invent_layout
from training.panoramas import Panorama
from training.surfaces import box_colour

Rng = np.random.Generator
SIZE = (3072, 1536)
"""Width and height of the panoramas, pixels: 8.5 a degree."""


@dataclass(eq=False)
class _Canvas:
    """Colour and distance of every pixel, and the unit rays through them, world z up."""

    width: int
    height: int
    colour: np.ndarray = field(init=False)
    distance: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.colour = np.zeros((self.height, self.width, 3), np.float32)
        self.distance = np.full((self.height, self.width), np.inf, np.float32)
        azimuth = (np.arange(self.width) + 0.5) / self.width * 2 * np.pi
        elevation = np.pi / 2 - (np.arange(self.height) + 0.5) / self.height * np.pi
        self.sin_azimuth = np.sin(azimuth).astype(np.float32)
        self.cos_azimuth = np.cos(azimuth).astype(np.float32)
        self.sin_elevation = np.sin(elevation).astype(np.float32)
        self.cos_elevation = np.cos(elevation).astype(np.float32)

    def rays(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, ...]:
        """x, y and z of the rays of a rectangle of pixels."""
        level = self.cos_elevation[rows, None]
        x = level * self.sin_azimuth[None, columns]
        y = level * self.cos_azimuth[None, columns]
        return x, y, np.broadcast_to(self.sin_elevation[rows, None], x.shape)

    def window(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns that hold all of these points (n, 3), relative to the camera."""
        azimuth = np.arctan2(xyz[:, 0], xyz[:, 1])
        middle = np.arctan2(xyz[:, 0].mean(), xyz[:, 1].mean())
        turn = (azimuth - middle + np.pi) % (2 * np.pi) - np.pi
        first = int(np.floor((middle + turn.min()) / (2 * np.pi) * self.width))
        last = int(np.ceil((middle + turn.max()) / (2 * np.pi) * self.width))
        columns = np.arange(first, min(last, first + self.width - 1) + 1) % self.width
        reach = np.hypot(xyz[:, 0], xyz[:, 1])
        near = min(reach.min(), np.abs(xyz[:, :2].mean(axis=0)).sum())
        heights = np.array([xyz[:, 2].min(), xyz[:, 2].max()])
        elevation = np.arctan2(heights[:, None], np.array([max(near * 0.6, 0.05), reach.max()]))
        edges = (0.5 - np.array([elevation.max(), elevation.min()]) / np.pi) * self.height
        top, bottom = np.clip([np.floor(edges[0]), np.ceil(edges[1]) + 1], 0, self.height)
        return np.arange(int(top), int(bottom)), columns


def _scene_rng(seed: int) -> Rng:
    return np.random.default_rng([seed, 0x57])


def scene_layout(seed: int) -> Layout:
    """What stands in the scene of a seed."""
    return invent_layout(_scene_rng(seed))


def street_panorama(seed: int, backdrops: list[Panorama], size: tuple[int, int] = SIZE) -> Panorama:
    """The scene of a seed; the sky is that of one of the ``backdrops``, or a plain one."""
    rng = _scene_rng(seed)
    layout = invent_layout(rng)
    canvas = _Canvas(*size)
    _paint_sky(canvas, backdrops, rng)
    _paint_ground(canvas, layout, draw_ground(layout, backdrops, rng))
    for box in layout.boxes:
        _paint_box(canvas, box, layout)
    for ball in layout.balls:
        _paint_ball(canvas, ball, layout, rng)
    _paint_haze(canvas, rng)
    picture = np.clip(canvas.colour, 0, 255).astype(np.uint8)
    return Panorama.of(f"street-{seed}", picture)


def _paint_sky(canvas: _Canvas, backdrops: list[Panorama], rng: Rng) -> None:
    if backdrops and rng.random() < 0.6:
        picture = backdrops[rng.integers(len(backdrops))].levels[0]
        picture = np.roll(picture, int(rng.integers(picture.shape[1])), axis=1)
        size = (canvas.width, canvas.height)
        canvas.colour[:] = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
        return
    horizon = rng.uniform(130, 250) + rng.normal(0, 12, 3)
    zenith = rng.uniform(0.4, 1) * horizon * [1.1, 0.95, 0.85]
    share = np.clip(canvas.sin_elevation, 0, 1)[:, None] ** 0.6
    canvas.colour[:] = (zenith * share + horizon * (1 - share))[:, None, :]


def _paint_ground(canvas: _Canvas, layout: Layout, ground: GroundPicture) -> None:
    azimuths = np.stack([canvas.sin_azimuth, canvas.cos_azimuth], axis=-1)
    rise = layout.rise_m(azimuths).astype(np.float32)
    falls = canvas.cos_elevation[:, None] * rise - canvas.sin_elevation[:, None]
    first = int(np.argmax((falls > 1e-3).any(axis=1)))
    falls = np.maximum(falls[first:], 1e-3)
    distance = layout.camera_height_m / falls
    reach = distance * canvas.cos_elevation[first:, None]
    seen = reach < 400
    across_m = distance / canvas.width * 2 * np.pi
    wanted_m = across_m / np.sqrt(falls)  # along the ray a pixel covers more
    rows = np.arange(first, canvas.height)
    for level, chosen in ground.levels_for(wanted_m):
        chosen &= seen
        part = np.flatnonzero(chosen.any(axis=1))
        x, y = reach[part] * canvas.sin_azimuth, reach[part] * canvas.cos_azimuth
        colour = ground.look_up(level, x, y)
        inside = chosen[part]
        painted = canvas.colour[rows[part]]
        painted[inside] = colour[inside]
        canvas.colour[rows[part]] = painted
    canvas.distance[first:][seen] = distance[seen]


def _paint_box(canvas: _Canvas, box: Box, layout: Layout) -> None:
    """A house stands level on a slope; everything else is sheared with the ground."""
    slope = np.float32(layout.slope)
    if box.surface == "facade":
        box, slope = layout.standing(box), np.zeros(2, np.float32)
    corners = box.corners()
    corners[:, 2] += corners[:, :2] @ slope - layout.camera_height_m
    rows, columns = canvas.window(corners)
    if not len(rows):
        return
    x, y, z = canvas.rays(rows, columns)
    z = z - slope[0] * x - slope[1] * y
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    ray = np.stack([c * x + s * y, -s * x + c * y, z])
    start = np.array(
        [
            -c * box.x_m - s * box.y_m,
            s * box.x_m - c * box.y_m,
            layout.camera_height_m - (box.bottom_m + box.top_m) / 2,
        ],
        np.float32,
    )
    half = np.array([box.half_x_m, box.half_y_m, (box.top_m - box.bottom_m) / 2], np.float32)
    ray = np.where(np.abs(ray) < 1e-6, np.float32(1e-6), ray)
    enter = (-np.sign(ray) * half[:, None, None] - start[:, None, None]) / ray
    leave = (np.sign(ray) * half[:, None, None] - start[:, None, None]) / ray
    near, far = enter.max(axis=0), leave.min(axis=0)
    at = np.ix_(rows, columns)
    hit = (near > 0.05) & (near < far) & (near < canvas.distance[at])
    if not hit.any():
        return
    axis = enter.argmax(axis=0)[hit]
    seen = ray[:, hit]
    point = start[:, None] + near[hit] * seen
    r, k = np.nonzero(hit)
    colour = box_colour(box, axis, -np.sign(seen[axis, np.arange(len(axis))]), point, layout)
    canvas.colour[rows[r], columns[k]] = colour
    canvas.distance[rows[r], columns[k]] = near[hit]


def _paint_ball(canvas: _Canvas, ball: Ball, layout: Layout, rng: Rng) -> None:
    """A tree's crown: a ball with a ragged edge."""
    place = np.array([ball.x_m, ball.y_m])
    centre = np.append(place, ball.z_m + layout.rise_m(place) - layout.camera_height_m)
    reach = np.linalg.norm(centre)
    if np.hypot(*centre[:2]) < 1.3 * ball.radius_m:
        return
    square = ball.radius_m * np.array(
        [[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], float
    )
    rows, columns = canvas.window(centre + square)
    if not len(rows):
        return
    x, y, z = canvas.rays(rows, columns)
    along = x * centre[0] + y * centre[1] + z * centre[2]
    off2 = reach**2 - along**2
    small = rng.normal(size=(max(2, len(rows) // 9), max(2, len(columns) // 9))).astype(np.float32)
    noise = cv2.resize(small, (len(columns), len(rows)), interpolation=cv2.INTER_CUBIC)
    fine = rng.normal(size=(max(2, len(rows) // 3), max(2, len(columns) // 3))).astype(np.float32)
    noise += 0.6 * cv2.resize(fine, (len(columns), len(rows)), interpolation=cv2.INTER_LINEAR)
    radius2 = ball.radius_m**2 * (0.85 + 0.15 * noise)
    at = np.ix_(rows, columns)
    depth = along - np.sqrt(np.maximum(radius2 - off2, 0))
    hit = (off2 < radius2) & (along > 0) & (depth < canvas.distance[at])
    if not hit.any():
        return
    lit = 0.75 + 0.25 * (z[hit] * depth[hit] - centre[2]) / ball.radius_m + 0.25 * noise[hit]
    r, k = np.nonzero(hit)
    canvas.colour[rows[r], columns[k]] = ball.colour * np.clip(lit, 0.2, 1.6)[:, None]
    canvas.distance[rows[r], columns[k]] = depth[hit]


def _paint_haze(canvas: _Canvas, rng: Rng) -> None:
    reach = np.float32(np.exp(rng.uniform(np.log(80), np.log(3000))))
    share = 1 - np.exp(-np.where(np.isfinite(canvas.distance), canvas.distance, 0) / reach)
    canvas.colour += share[..., None] * (np.float32(rng.uniform(140, 225)) - canvas.colour)
