"""How the program is started, and people in front of a camera."""

import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from scene4d.core.camera import Camera

PROGRAM = [sys.executable, "-c", "from scene4d.cli import main; main()"]
SIZE = (1280, 720)


def people(camera: Camera, n: int = 60, seed: int = 1) -> np.ndarray:
    """Boxes (n, 4) as x1 y1 x2 y2 of people 0.5 m wide who stand about a camera's view."""
    rng = np.random.default_rng(seed)
    width, height = camera.image_size
    boxes: list[tuple[float, ...]] = []
    while len(boxes) < n:
        x, y = rng.uniform(-15, 15), rng.uniform(6, 45)
        tall = rng.normal(1.70, 0.06)
        ends, seen = camera.project(np.array([[x, y, 0.0], [x, y, tall]]))
        (u, foot), (_, head) = ends
        half = 0.15 * (foot - head)
        inside = u - half > 5 and u + half < width - 5 and head > 5 and foot < height - 5
        if seen.all() and inside:
            boxes.append((u - half, head, u + half, foot))
    return np.array(boxes)


def mot_text(boxes: np.ndarray) -> str:
    """Boxes as MOTChallenge detections, a frame for every five."""
    lines = [
        f"{i // 5 + 1},-1,{x1:.2f},{y1:.2f},{x2 - x1:.2f},{y2 - y1:.2f},1,-1,-1,-1"
        for i, (x1, y1, x2, y2) in enumerate(boxes)
    ]
    return "\n".join(lines) + "\n"


def save_images(folder: Path, images: Sequence[np.ndarray]) -> Path:
    folder.mkdir()
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i}.jpg"), image)
    return folder
