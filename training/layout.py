"""What stands in an invented scene, and where: pure geometry, in metres.

The camera's foot is the origin; x and y lie on the ground, z is up.
"""

from dataclasses import dataclass, field, replace

import numpy as np

Rng = np.random.Generator
KINDS = ("street", "car park", "square", "lawn")
SLOPED_SHARE = 0.33
"""Of the scenes: enough that the ground alone does not tell which way is up."""


@dataclass(eq=False)
class Box:
    """An upright box turned by ``yaw_rad`` about the vertical; ``surface`` names its texture."""

    x_m: float
    y_m: float
    yaw_rad: float
    half_x_m: float
    half_y_m: float
    bottom_m: float
    top_m: float
    surface: str
    colour: np.ndarray
    seed: int = 0

    def footprint(self) -> np.ndarray:
        """Corners on the ground, (4, 2), in order."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [self.half_x_m, self.half_y_m]
        return local @ np.array([[c, s], [-s, c]]) + [self.x_m, self.y_m]

    def corners(self) -> np.ndarray:
        """All eight corners, (8, 3)."""
        foot = self.footprint()
        return np.vstack(
            [np.column_stack([foot, np.full(4, z)]) for z in (self.bottom_m, self.top_m)]
        )


@dataclass(eq=False)
class Ball:
    """A tree's crown."""

    x_m: float
    y_m: float
    z_m: float
    radius_m: float
    colour: np.ndarray


@dataclass(eq=False)
class Layout:
    """A scene. ``sun`` is the direction towards the sun, (3,), or None on an overcast day."""

    kind: str
    camera_height_m: float
    axis_rad: float
    road_offset_m: float
    road_width_m: float
    sun: np.ndarray | None
    boxes: list[Box] = field(default_factory=list)
    balls: list[Ball] = field(default_factory=list)
    slope: tuple[float, float] = (0.0, 0.0)
    """Rise of the ground per metre along x and y; z of boxes and balls is above the ground."""

    def rise_m(self, xy_m: np.ndarray) -> np.ndarray:
        """Height (n,) of the ground at places (n, 2), above that at the camera's foot."""
        return xy_m @ np.array(self.slope)

    def standing(self, box: Box) -> Box:
        """A house as it stands on a slope: level, and reaching down to the ground on all sides."""
        rises = self.rise_m(box.footprint())
        return replace(
            box,
            bottom_m=box.bottom_m + float(rises.min()),
            top_m=box.top_m + float(rises.mean()) + float(np.ptp(rises)) / 2,
        )

    def place(self, along_m: float, across_m: float) -> tuple[float, float]:
        """From coordinates along and across the scene's main axis to x and y."""
        c, s = np.cos(self.axis_rad), np.sin(self.axis_rad)
        return c * along_m - s * across_m, s * along_m + c * across_m

    def free(self, x_m: float, y_m: float, reach_m: float) -> bool:
        """Whether nothing of this reach would stand in the camera's own face."""
        return float(np.hypot(x_m, y_m)) > reach_m + 1.2


def invent_layout(rng: Rng) -> Layout:
    """A random scene with a camera at 2.2-15 m; a third of them on a slope."""
    elevation, azimuth = rng.uniform(0.25, 1.3), rng.uniform(0, 2 * np.pi)
    sun = np.array([np.sin(azimuth), np.cos(azimuth), np.tan(elevation)])
    layout = Layout(
        kind=str(rng.choice(KINDS, p=(0.45, 0.25, 0.2, 0.1))),
        camera_height_m=float(np.exp(rng.uniform(np.log(2.2), np.log(15)))),
        axis_rad=rng.uniform(0, 2 * np.pi),
        road_offset_m=rng.uniform(3, 14),
        road_width_m=rng.uniform(5, 14),
        sun=sun / np.linalg.norm(sun) if rng.random() < 0.6 else None,
    )
    _add_buildings(layout, rng)
    _add_cars(layout, rng)
    _add_people(layout, rng)
    _add_furniture(layout, rng)
    if rng.random() < SLOPED_SHARE:
        layout.slope = random_slope(rng)
    return layout


def random_slope(rng: Rng) -> tuple[float, float]:
    """Rise per metre along two axes, of a slope of 3-20° in any direction."""
    steep, direction = np.tan(np.radians(rng.uniform(3, 20))), rng.uniform(0, 2 * np.pi)
    return float(steep * np.cos(direction)), float(steep * np.sin(direction))


def _shade(rng: Rng, low: float = 30, high: float = 230) -> np.ndarray:
    """A mostly grey colour, BGR."""
    return np.clip(rng.uniform(low, high) + rng.normal(0, 18, 3), 5, 250).astype(np.float32)


def _add_buildings(layout: Layout, rng: Rng) -> None:
    rows = [(1, layout.road_offset_m + layout.road_width_m), (-1, rng.uniform(3, 25))]
    if layout.kind != "street":
        rows = [(side, rng.uniform(18, 60)) for side in (1, -1)]
    for side, clear_m in rows:
        if rng.random() < 0.2:
            continue
        along, sidewalk = -rng.uniform(60, 120), rng.uniform(1.5, 6)
        while along < 120:
            half_x, half_y = rng.uniform(4, 22), rng.uniform(4, 12)
            if rng.random() < 0.8:
                across = side * (clear_m + sidewalk + half_y + rng.uniform(0, 3))
                x, y = layout.place(along + half_x, across)
                if layout.free(x, y, float(np.hypot(half_x, half_y))):
                    layout.boxes.append(
                        Box(
                            x, y, layout.axis_rad, half_x, half_y, 0.0,
                            float(np.exp(rng.uniform(np.log(3), np.log(35)))),
                            "facade", _shade(rng, 60, 230), int(rng.integers(1 << 30)),
                        )
                    )  # fmt: skip
            along += 2 * half_x + rng.choice([0.0, rng.uniform(1, 20)])


def _add_cars(layout: Layout, rng: Rng) -> None:
    if layout.kind == "car park":
        pitch, gap = rng.uniform(2.4, 2.9), rng.uniform(14, 18)
        for row in range(-3, 4):
            for stall in range(-18, 19):
                if rng.random() < 0.35:
                    across = row * gap + rng.choice([-2.6, 2.6]) + layout.road_offset_m
                    turn = layout.axis_rad + np.pi / 2 + rng.normal(0, 0.03)
                    add_car(layout, rng, *layout.place(stall * pitch, across), turn)
        return
    if layout.kind == "lawn":
        return
    for _ in range(rng.integers(0, 22)):
        lane = layout.road_offset_m + rng.uniform(0.12, 0.88) * layout.road_width_m
        x, y = layout.place(rng.uniform(-70, 70), lane)
        add_car(layout, rng, x, y, layout.axis_rad + rng.choice([0, np.pi]) + rng.normal(0, 0.05))


def add_car(layout: Layout, rng: Rng, x: float, y: float, yaw: float) -> None:
    """A car, a van or a lorry out of two boxes and four wheels painted on."""
    if not layout.free(x, y, 3.0) and layout.camera_height_m < 3.2:
        return
    colour, seed = _shade(rng, 10, 245), int(rng.integers(1 << 30))
    if rng.random() < 0.25:
        colour = rng.uniform(10, 220, 3).astype(np.float32)
    big = rng.random() < 0.15
    half_x, half_y = (rng.uniform(2.4, 5), 1.05) if big else (rng.uniform(1.9, 2.4), 0.88)
    waist, top = (0.9, rng.uniform(1.9, 3.4)) if big else (rng.uniform(0.8, 1.0), 1.48)
    body = Box(x, y, yaw, half_x, half_y, 0.18, waist, "car", colour, seed)
    inner_x = half_x * (0.97 if big else 0.55)
    back = 0.0 if big else -0.15 * half_x
    c, s = np.cos(yaw), np.sin(yaw)
    cabin = Box(
        x + c * back, y + s * back, yaw, inner_x, half_y * 0.92, waist, top, "cabin", colour, seed
    )
    layout.boxes += [body, cabin]


def _add_people(layout: Layout, rng: Rng) -> None:
    for _ in range(rng.integers(0, 16)):
        x, y = layout.place(rng.uniform(-25, 25), rng.uniform(-20, 30))
        if not layout.free(x, y, 0.8):
            continue
        height, yaw = rng.normal(1.70, 0.09), rng.uniform(0, np.pi)
        for low, high, half, colour in (
            (0.0, 0.48, 0.15, _shade(rng, 20, 120)),
            (0.48, 0.84, 0.22, rng.uniform(10, 230, 3).astype(np.float32)),
            (0.86, 1.0, 0.09, np.array([110, 140, 190], np.float32) * rng.uniform(0.3, 1.1)),
        ):
            layout.boxes.append(
                Box(x, y, yaw, half, 0.11, low * height, high * height, "plain", colour)
            )


def _add_furniture(layout: Layout, rng: Rng) -> None:
    """Poles, trees, fences and low walls."""
    spacing, across = rng.uniform(8, 35), layout.road_offset_m - rng.uniform(0.6, 2)
    tall, colour = rng.uniform(3, 10), _shade(rng)
    for step in range(-4, 5):
        x, y = layout.place(step * spacing + 3, across)
        if layout.free(x, y, 0.3) and rng.random() < 0.7:
            layout.boxes.append(Box(x, y, 0.3, 0.06, 0.06, 0, tall, "plain", colour))
    for _ in range(rng.integers(0, 14)):
        x, y = layout.place(rng.uniform(-60, 60), rng.uniform(-40, 50))
        radius, trunk = rng.uniform(0.8, 4), rng.uniform(0.5, 4)
        if layout.free(x, y, radius):
            green = np.array([40, 90, 60], np.float32) * rng.uniform(0.4, 1.6)
            green = green + rng.normal(0, 12, 3).astype(np.float32)
            layout.balls.append(Ball(x, y, trunk + radius * 0.8, radius, np.clip(green, 5, 240)))
            bark = np.array([50, 60, 75], np.float32)
            layout.boxes.append(Box(x, y, 0, 0.13, 0.13, 0, trunk + 0.3, "plain", bark))
    if rng.random() < 0.4:
        x, y = layout.place(rng.uniform(-10, 10), -rng.uniform(3, 14))
        half = rng.uniform(5, 40)
        if layout.camera_height_m > 3:
            layout.boxes.append(
                Box(x, y, layout.axis_rad, half, 0.1, 0, rng.uniform(0.5, 2.5), "wall",
                    _shade(rng), int(rng.integers(1 << 30)))
            )  # fmt: skip
