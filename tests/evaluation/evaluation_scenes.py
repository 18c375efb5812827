"""Synthetic evaluations for the tests of figures and page: cameras wrong by a known amount."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import report_scenes as scenes
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.ground_map import GroundMap
from scene4d.core.people import Segments
from scene4d.drawing.scenery import image_of, in_frame
from scene4d.drawing.style import Drawn
from scene4d.evaluation import Reference
from scene4d.evaluation.pages.page import draw_evaluation
from scene4d.evaluation.trials.outcomes import PAPER_HEIGHTS_M, Evaluation, Outcome, Setting

HEIGHTS = tuple(sorted({*PAPER_HEIGHTS_M, 1.70}))
PAPER = Setting("drawn boxes", "paper", "true orientation")
JOINT = Setting("keypoints <video>", "joint", "nothing")
TOLD = np.diag([0.0, 0.0, 0.0, 0.02, 0.0]) ** 2


def truth(turn: float = 0.0) -> Camera:
    """The true camera, in a world turned and shifted against that of the estimates."""
    camera = scenes.camera(distortion=(-0.15, 0, 0, 0, 0))
    c, s = np.cos(turn), np.sin(turn)
    R = camera.R @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    centre = np.array([3.0, -2.0, camera.height_m]) * [bool(turn), bool(turn), 1]
    return replace(camera, R=R, t=-R @ centre)


def ground_map(camera: Camera) -> GroundMap:
    """The true ground of a camera without distortion, as a homography alone."""
    return GroundMap(camera.image_size, np.linalg.inv(camera.P[:, [0, 1, 3]]))


@cache
def park() -> Reference:
    """The reference of most tests: drawing points on the ground through a lens takes its time."""
    return reference(truth())


def reference(camera: Camera | GroundMap, n: int = 300) -> Reference:
    seen = camera if isinstance(camera, Camera) else scenes.camera()
    rng = np.random.default_rng(3)
    uv = rng.uniform([0, 150], [768, 575], (n, 2))
    xy, _ = seen.locate(uv)
    near = np.hypot(*(xy - seen.centre_m[:2]).T) < 45
    uv = image_of(seen, np.column_stack([xy[near], np.zeros(near.sum())]))
    return Reference("a park", camera, uv[in_frame(uv, seen.image_size)])


@cache
def people() -> Segments:
    return scenes.people(truth(), 40)[0]


def calibration(camera: Camera, method: str, height_m: float) -> Calibration:
    inlier = np.arange(40) % 4 > 0
    values: dict[str, Any] = {
        "status": "ok",
        "method": method,
        "image_size": camera.image_size,
        "person_height_m": height_m,
        "camera": camera,
        "covariance": TOLD if method == "paper" else scenes.COVARIANCE,
        "segments": people(),
        "inlier": inlier,
        "ground_error_m": {"median": 0.4, "p90": 0.9},
        "frames": 9,
    }
    return Calibration(**values)


def outcome(setting: Setting, height_m: float, known: Reference, camera: Camera) -> Outcome:
    return Outcome.scored(setting, calibration(camera, setting.method, height_m), known)


def line(setting: Setting, known: Reference, focal: float = 1.0, scale: float = 1.0) -> list:
    """A setting at all heights: wrong by a factor on the focal length, and by scale and height."""
    true = known.truth if isinstance(known.truth, Camera) else scenes.camera()
    base = {"distortion": true.distortion, "focal_px": focal * 1185.0}
    return [
        outcome(setting, h, known, scenes.camera(**base, height_m=scale * 7.07 * h / 1.70))
        for h in HEIGHTS
    ]


def refused(setting: Setting, reason: str) -> list[Outcome]:
    return [Outcome(setting, h, reason=reason) for h in HEIGHTS]


@cache
def whole() -> Evaluation:
    return evaluation(park())


@cache
def drawn() -> dict[str, Drawn]:
    return draw_evaluation(whole())


def evaluation(known: Reference, **changes: Any) -> Evaluation:
    circular = Setting("published boxes", "joint", "lens", circular=True)
    boxes = Setting("drawn boxes", "joint", "nothing")
    values: dict[str, Any] = {
        "name": "towncentre",
        "reference": known,
        "image_bgr": picture(),
        "notes": ("the network <is> missing",),
    }
    if "outcomes" not in changes:
        values["outcomes"] = (
            *line(PAPER, known, scale=1.02),
            *line(circular, known),
            *refused(boxes, "boxes alone do not determine f < g"),
            *line(JOINT, known, focal=1.08),
        )
    return Evaluation(**(values | changes))


def picture() -> np.ndarray:
    rng = np.random.default_rng(0)
    coarse = rng.integers(60, 200, (36, 48, 3), dtype=np.uint8)
    return np.kron(coarse, np.ones((16, 16, 1), np.uint8))
