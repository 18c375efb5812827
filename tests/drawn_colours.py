"""Drawn people and cars of known colours, under lights, in shade, with noise and compression.

Truth is what people called colours: the XKCD survey, as matplotlib has it, with the saturation that
fabrics and paint have; black, grey and white, of which it has few, are all greys of a lightness.
"""

from functools import cache

import cv2
import numpy as np
from matplotlib.colors import XKCD_COLORS, to_rgb

from scene4d.core.body import HALPE26
from scene4d.core.colours import CLOTHES, NAMES, VEHICLES, members
from scene4d.core.people import Detections
from scene4d.perception.colours import ColourReader
from scene4d.tracking._colours import Colours

SIZE = (360, 240)
FABRIC = 0.75
NEUTRAL = {"black": (4, 24), "grey": (32, 78), "white": (84, 97)}
OTHER_WORDS = {"gray": "grey", "violet": "purple"}
GROUNDS = ((0.10, 0.22, 0.12), (0.25, 0.25, 0.26), (0.30, 0.38, 0.45), (0.55, 0.58, 0.6))
"""Grass, asphalt, sand, plaster: linear B, G, R."""


@cache
def _said() -> dict[str, np.ndarray]:
    """Linear B, G, R of what was called by each name."""
    found: dict[str, list] = {name: [] for name in NAMES}
    for said, value in XKCD_COLORS.items():
        word = said.split(":")[1].split()[-1]
        name = OTHER_WORDS.get(word, word)
        if name in NAMES and name not in NEUTRAL:
            lab = cv2.cvtColor(np.float32([[to_rgb(value)]]), cv2.COLOR_RGB2Lab)
            lab[..., 1:] *= FABRIC
            found[name].append(cv2.cvtColor(lab, cv2.COLOR_Lab2LBGR)[0, 0])
    return {name: np.clip(found[name], 0, 1) for name in NAMES if name not in NEUTRAL}


def thing(rng: np.random.Generator, common: np.ndarray) -> tuple[str, np.ndarray]:
    """A name, as often as it is common, and a colour that is called so."""
    share = np.array([common[members(name)].sum() for name in NAMES])
    name = str(rng.choice(NAMES, p=share / share.sum()))
    if name not in NEUTRAL:
        some = _said()[name]
        return name, some[rng.integers(len(some))]
    lab = np.float32([[[rng.uniform(*NEUTRAL[name]), *rng.normal(0, 1.5, 2)]]])
    return name, np.clip(cv2.cvtColor(lab, cv2.COLOR_Lab2LBGR)[0, 0], 0, 1)


def scene(
    rng: np.random.Generator, people: int = 5, cast: float = 0.07, looks: int = 4
) -> tuple[list[tuple[str, str]], np.ndarray, np.ndarray]:
    """One picture after the other of some people and a car: what they are in (upper, lower; the car
    twice), their probabilities (``Tracks.colours``), and who is a person.
    """
    light = np.exp(rng.normal(0, cast, 3) + rng.normal(0, 0.2))
    ground = np.array(GROUNDS[rng.integers(len(GROUNDS))])
    linear = ground * np.exp(rng.normal(0, 0.4, (*SIZE[::-1], 1)))
    for _ in range(12):  # walls, doors, signs
        x, y = rng.integers(0, SIZE[0]), rng.integers(0, SIZE[1] // 3)
        linear[y : y + 30, x : x + 40] = rng.uniform(0.03, 0.85) * np.exp(rng.normal(0, 0.15, 3))
    worn, boxes, points = [], [], []
    for k in range(people):
        box = _box(rng, k)
        (upper, above), (lower, below) = (thing(rng, CLOTHES) for _ in range(2))
        points.append(_draw_person(linear, box, above, below, rng))
        worn.append((upper, lower))
        boxes.append(box)
    name, paint = thing(rng, VEHICLES)
    boxes.append(np.array([20.0, 185, 110, 235]))
    _draw_car(linear, boxes[-1], paint, rng)
    worn.append((name, name))
    n = people + 1
    colours, reader = Colours(), ColourReader()
    for look in range(looks):
        table = Detections.from_boxes(
            SIZE,
            np.full(n, look),
            np.array(boxes),
            time_s=np.full(n, float(look)),
            class_name=np.array(["person"] * people + ["car"]),
            keypoint_uv=np.concatenate([points, np.full((1, 26, 2), np.nan)]),
            keypoint_score=np.repeat([[0.9]] * people + [[0.0]], 26, axis=1),
            keypoint_names=HALPE26,
        )
        readings = reader.read(_photo(linear * light, rng), float(look), table)
        colours.add(table, np.arange(n), readings.astype(float))
    kinds = table.class_name
    return worn, colours.of(np.arange(n), kinds), kinds == "person"


def _box(rng: np.random.Generator, k: int) -> np.ndarray:
    height = rng.uniform(50, 150)
    x, y = 45 + 70 * k, rng.uniform(height + 2, 180)
    return np.array([x - 0.2 * height, y - height, x + 0.2 * height, y])


def _draw_person(linear, box, above, below, rng) -> np.ndarray:
    (x1, y1, x2, _), height = box, box[3] - box[1]
    x, wide = (x1 + x2) / 2, x2 - x1
    shade = np.exp(rng.normal(0, 0.4))  # in sun or shade
    skin = np.array([0.15, 0.22, 0.38]) * rng.uniform(0.3, 1.3)
    y = y1 + height * np.array([0.0, 0.17, 0.52, 0.75, 1.0])
    for top, bottom, half, value in (
        (y[0], y[1], 0.15, skin),
        (y[1], y[2], 0.36, above),
        (y[2], y[4], 0.26, below),
    ):
        part = linear[round(top) : round(bottom), round(x - half * wide) : round(x + half * wide)]
        folds = np.exp(rng.normal(0, 0.15, (*part.shape[:2], 1)))
        part[:] = value * shade * folds
    uv = np.full((26, 2), np.nan)
    for row, sides, half in ((y[1], (5, 6), 0.3), (y[2], (11, 12), 0.17), (y[3], (13, 14), 0.17)):
        for joint, sign in zip(sides, (1, -1), strict=True):
            uv[joint] = x + sign * half * wide + rng.normal(0, 1), row + rng.normal(0, 1)
    return np.nan_to_num(uv)


def _draw_car(linear, box, paint, rng) -> None:
    x1, y1, x2, y2 = box.round().astype(int)
    shade = np.exp(rng.normal(0, 0.4))
    linear[y1:y2, x1:x2] = 0.03
    middle = (y1 + 2 * y2) // 3
    linear[(y1 + y2) // 2 - 4 : middle + 8, x1:x2] = paint * shade
    linear[y1 : y1 + 8, x1 + 20 : x2 - 15] = paint * shade


def _photo(linear: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A blurred, noisy, compressed picture."""
    seen = cv2.GaussianBlur(np.clip(linear, 0, 1).astype(np.float32), (0, 0), 0.7)
    curve = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    noisy = np.clip(255 * curve + rng.normal(0, 4, seen.shape), 0, 255).astype(np.uint8)
    _, content = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 60])
    return cv2.imdecode(content, cv2.IMREAD_COLOR)
