"""Upright bodies seen by a camera: keypoints, and boxes around a solid body, with known noise."""

from dataclasses import dataclass

import numpy as np
from tests.strategies import build_camera, build_lens, people_scene

from scene4d.core.body import HALPE26
from scene4d.core.camera import Camera
from scene4d.core.people import Detections

FOOT_Z = 0.04


@dataclass(frozen=True, eq=False)
class Crowd:
    """People as they are, (n, ...): the middle of the body, height, and where it faces."""

    camera: Camera
    xy_m: np.ndarray
    height_m: np.ndarray
    yaw_rad: np.ndarray

    def image(self, points_m: np.ndarray) -> np.ndarray:
        """Pixels of the footage (n, k, 2) of world points (n, k, 3)."""
        n, k, _ = points_m.shape
        uv, valid = self.camera.project(points_m.reshape(-1, 3))
        assert valid.all()
        return uv.reshape(n, k, 2)

    @property
    def length_px(self) -> np.ndarray:
        """Length of a person of 1.70 m there, at right angles to the line of sight (n,)."""
        at = np.column_stack([self.xy_m, np.full(len(self.xy_m), 0.85)])
        return 1.70 * self.camera.focal_px / (at @ self.camera.R[2] + self.camera.t[2])


def crowd(camera: Camera, n: int, rng: np.random.Generator, height_sigma: float = 0.09) -> Crowd:
    scene = people_scene(
        camera, n, rng, noise=0.0, noise_px=0.0, height_sigma=height_sigma, distorted=True
    )
    return Crowd(camera, scene.xy_m, scene.height_m, rng.uniform(-np.pi, np.pi, n))


def cameras(many: int) -> list[Camera]:
    """Cameras as they hang over streets: some wide, some long, some bent, all different."""
    rng = np.random.default_rng(11)
    made = []
    for i in range(many):
        bend = rng.uniform(-0.06, 0.06) if i % 2 else 0.0
        lens = build_lens((1280, 720), rng.uniform(25, 70), radial=(bend, 0.0, 0.0))
        pose = rng.uniform(12, 45), rng.uniform(-8, 8), rng.uniform(4, 12), rng.uniform(-180, 180)
        made.append(build_camera(lens, *pose, xy_m=(3.0, -7.0)))
    return made


def with_keypoints(
    people: Crowd,
    rng: np.random.Generator | None = None,
    *,
    share: float = 0.025,
    sway_m: float = 0.085,
    twist_m: float = 0.0,
) -> Detections:
    """Head top, shoulders, toes and heels; noise only where a generator is given."""
    n = len(people.xy_m)
    ahead = np.column_stack([np.cos(people.yaw_rad), np.sin(people.yaw_rad)])
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    points = np.zeros((n, len(HALPE26), 3))
    points[:, :, :2] = people.xy_m[:, None]
    points[:, :, 2] = people.height_m[:, None] / 2

    def put(name: str, forwards: float, leftwards: float, z: np.ndarray | float) -> None:
        column = HALPE26.index(name)
        points[:, column, :2] += forwards * ahead + leftwards * left
        points[:, column, 2] = z

    put("head_top", 0.0, 0.0, people.height_m)
    for side, sign in (("left", 1), ("right", -1)):
        put(f"{side}_shoulder", 0.0, sign * 0.165, 0.82 * people.height_m)
        put(f"{side}_heel", -0.32 / 3, sign * 0.10, FOOT_Z)
        put(f"{side}_big_toe", 0.16 / 3, sign * 0.08, FOOT_Z)
        put(f"{side}_small_toe", 0.16 / 3, sign * 0.12, FOOT_Z)
    if rng is not None:
        points[:, :, :2] += sway_m * rng.normal(size=(n, 1, 2))
        # Shoulders twist, and feet turn, each by itself.
        for columns in ([5], [20, 22], [21, 23]):
            points[:, columns, :2] += twist_m * rng.normal(size=(n, 1, 2))
    uv = people.image(points)
    if rng is not None:
        # Points of one foot, and both feet, err together: the mean of six has the stated share.
        noise = np.hypot(1.0, share * people.length_px)[:, None, None]
        ends = noise * rng.normal(size=(n, 2, 2))
        uv[:, 20:] += ends[:, :1]
        uv[:, 17] += ends[:, 1]
    low, high = uv[:, [17, *range(20, 26)]].min(axis=1), uv[:, [17, *range(20, 26)]].max(axis=1)
    return Detections.from_boxes(
        people.camera.image_size,
        np.zeros(n),
        np.hstack([low - 2, high + 2]),
        keypoint_uv=uv,
        keypoint_score=np.full((n, len(HALPE26)), 0.9),
        keypoint_names=HALPE26,
    )


def with_boxes(
    people: Crowd,
    rng: np.random.Generator | None = None,
    *,
    share: float = 0.08,
    sway_m: float = 0.085,
) -> Detections:
    """Boxes around a ring of 0.25 m at the feet and a ball of 0.10 m at the head."""
    n = len(people.xy_m)
    xy = people.xy_m
    if rng is not None:
        xy = xy + sway_m * rng.normal(size=(n, 2))
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    ring = np.column_stack([0.25 * np.cos(turn), 0.25 * np.sin(turn), 0 * turn])
    up, around = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 31), turn[::2])
    ball = 0.10 * np.column_stack(
        [
            (np.cos(up) * np.cos(around)).ravel(),
            (np.cos(up) * np.sin(around)).ravel(),
            np.sin(up).ravel(),
        ]
    )
    foot = np.column_stack([xy, np.zeros(n)])
    head = np.column_stack([xy, people.height_m - 0.10])
    ring_uv = people.image(foot[:, None] + ring)
    ball_uv = people.image(head[:, None] + ball)
    # The middle of a box is that of the whole body, which leans in the image.
    ends = people.image(np.stack([foot, foot + people.height_m[:, None] * [0, 0, 1]], axis=1))
    middle, lean = ends[:, :, 0].mean(axis=1), np.ptp(ends[:, :, 0], axis=1)
    top, bottom = ball_uv[:, :, 1].min(axis=1), ring_uv[:, :, 1].max(axis=1)
    if rng is not None:
        length = people.length_px
        top = top + np.hypot(1.0, share * length) * rng.normal(size=n)
        bottom = bottom + np.hypot(1.0, share * length) * rng.normal(size=n)
        middle = middle + np.hypot(1.0, 0.03 * length) * rng.normal(size=n)
    half = 0.12 * (bottom - top) + lean / 2
    box = np.column_stack([middle - half, top, middle + half, bottom])
    return Detections.from_boxes(people.camera.image_size, np.zeros(n), box)
