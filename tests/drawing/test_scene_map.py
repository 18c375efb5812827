"""The view of a scene from above."""

import cv2
import numpy as np

from scene4d.core.camera import Camera
from scene4d.drawing.scene_map import draw_scene_map
from strategies import build_camera

CAMERA: Camera = Camera.from_pose(
    image_size=(640, 480), focal_px=600.0, tilt_rad=0.35, roll_rad=0.0, height_m=5.0
)
WALK = np.column_stack([np.linspace(-3, 3, 30), np.linspace(10, 20, 30)])


def pixels(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def blue(image: np.ndarray) -> int:
    """Pixels in about the colour of people."""
    return int((image[..., 0].astype(int) - image[..., 2] > 100).sum())


def orange(image: np.ndarray) -> int:
    """Pixels in about the colour of cars."""
    return int((image[..., 2].astype(int) - image[..., 0] > 100).sum())


def test_paths_are_drawn_where_people_went():
    alone = pixels(draw_scene_map(CAMERA, {1: ("person", WALK)}))
    standing = pixels(draw_scene_map(CAMERA, {1: ("person", np.repeat(WALK[:1], 30, axis=0))}))
    assert blue(alone) > 3 * blue(standing) > 0


def test_vehicles_have_a_colour_of_their_own():
    image = pixels(draw_scene_map(CAMERA, {1: ("bus", WALK)}))
    assert orange(image) > 500
    assert blue(image) == 0


def test_the_same_scene_gives_the_same_picture():
    paths = {1: ("person", WALK), 2: ("car", WALK[::-1] + 2)}
    assert draw_scene_map(CAMERA, paths) == draw_scene_map(CAMERA, paths)


def test_nobody_on_the_ground_gives_no_picture():
    assert draw_scene_map(CAMERA, {}) is None
    assert draw_scene_map(CAMERA, {1: ("person", np.empty((0, 2)))}) is None


def test_any_camera_can_be_drawn():
    for tilt, height in ((5.0, 12.0), (75.0, 3.0)):
        camera = build_camera(tilt_deg=tilt, height_m=height)
        there = camera.locate(np.array([[640.0, 600.0], [500.0, 700.0]]))[0]
        assert draw_scene_map(camera, {1: ("person", there)}) is not None
