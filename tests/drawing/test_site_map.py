"""The plan of a site and the points of one view in another: what must be seen is there."""

import cv2
import numpy as np
import pytest

from scene4d.drawing.other_view import Matched, draw_other_view
from scene4d.drawing.site_map import Way, draw_site_map, field_of_view
from strategies import build_camera, build_lens

LENS = build_lens((1280, 720), 60.0)
CAMERA = build_camera(LENS, 25.0, 0.0, 5.0)
AHEAD, ASIDE = np.array([0.0, 10.0]), np.array([60.0, 0.0])
OTHER = build_camera(LENS, 30.0, 0.0, 4.0, 150.0, (4.0, 20.0))


def pixels(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def has(image: np.ndarray, colour: str) -> int:
    bgr = [int(colour[k : k + 2], 16) for k in (5, 3, 1)]
    return int((np.abs(image.astype(int) - bgr).max(axis=2) < 30).sum())


def test_what_a_camera_sees_is_what_it_locates():
    outline = field_of_view(CAMERA, 12.0)
    distance = np.hypot(*(outline - CAMERA.centre_m[:2]).T)
    assert distance.max() < 12.5 and distance.min() > 2.0
    uv, seen = CAMERA.project(np.column_stack([outline * 0.999, np.zeros(len(outline))]))
    assert seen.all() and (np.abs(uv[:, 0] - 640) < 660).all()
    up = build_camera(LENS, -60.0, 0.0, 5.0)
    assert field_of_view(up, 12.0).shape == (0, 2)


def test_the_plan_shows_cameras_ellipses_and_ways_by_number():
    rng = np.random.default_rng(0)
    ways = [Way(k, np.cumsum(rng.normal(0, 0.4, (40, 2)), axis=0) + AHEAD, k) for k in (1, 2)]
    cameras = {"west": CAMERA, "east": OTHER}
    plain = draw_site_map(cameras, {}, ways)
    sure = draw_site_map(cameras, {"east": 0.5 * np.eye(2)}, ways, true={"east": OTHER})
    assert [label for label, _ in plain.legend] == [
        "west", "east", "1 seen by several cameras", "1 seen by one",
    ]  # fmt: skip
    assert "true camera" in [label for label, _ in sure.legend]
    image = pixels(plain.png)
    assert has(image, "#0072B2") > 60 and has(image, "#D55E00") > 60
    assert has(pixels(sure.png), "#D55E00") > has(image, "#D55E00") + 100
    assert plain.png == draw_site_map(cameras, {}, ways).png


@pytest.mark.parametrize("image", [None, np.full((720, 1280, 3), 90, np.uint8)])
def test_points_of_the_other_view_lie_where_it_puts_them(image):
    own = np.array([[300.0, 400.0], [900.0, 500.0], [np.nan, 1.0]])
    matched = Matched(own, own + ASIDE)
    png = draw_other_view(image, (1280, 720), matched, ("west", "east")).png
    drawn = pixels(png)
    scale = drawn.shape[1] / 1280
    for uv, colour in ((own[:2], "#3A8DFF"), (own[:2] + ASIDE, "#FFC845")):
        for u, v in uv * scale:
            near = drawn[int(v) - 5 : int(v) + 6, int(u) - 5 : int(u) + 6]
            assert has(near, colour) > 5
