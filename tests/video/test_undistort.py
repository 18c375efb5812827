"""Undistorted frames agree with the geometry of points."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.video.undistort import Undistorter

DISTORTION = np.array([-0.3, 0.1, 1e-3, -2e-3, 0.01])


def lens(distortion: np.ndarray = DISTORTION, skew: float = 0.0) -> Lens:
    K = np.array([[500, skew, 330.0], [0, 480, 170], [0, 0, 1]])
    return Lens((640, 360), K, distortion)


def fisheye(skew: float) -> Lens:
    curve = np.array([-0.05, 0.02, -0.01, 0.002])
    return replace(lens(skew=skew), distortion=curve, distortion_model="fisheye")


@pytest.mark.parametrize("skew", [0.0, 25.0])
@pytest.mark.parametrize("kind", ["pinhole", "fisheye"])
def test_a_mark_moves_to_where_its_point_is_undistorted(skew, kind):
    camera = fisheye(skew) if kind == "fisheye" else lens(skew=skew)
    undistorter = Undistorter(camera)
    for uv in [(60, 50), (330, 170), (580, 300), (100, 310), (500, 40)]:
        image = np.zeros((360, 640, 3), np.uint8)
        image[uv[1] - 2 : uv[1] + 3, uv[0] - 2 : uv[0] + 3] = 255
        weight = undistorter(image)[:, :, 0].astype(float)
        v, u = np.mgrid[:360, :640]
        found = np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()
        expected, valid = camera.undistort(np.array([uv], float))
        assert valid.all()
        assert np.abs(found - expected[0]).max() < 0.3


def test_the_same_picture_as_opencv_makes(textured):
    camera = lens()
    reference = cv2.undistort(textured, camera.K, camera.distortion)
    assert np.abs(Undistorter(camera)(textured).astype(int) - reference).max() <= 2


def test_without_distortion_the_frame_is_left_alone(textured):
    assert Undistorter(lens(np.zeros(5)))(textured) is textured


def test_a_frame_of_another_size_is_refused(textured):
    with pytest.raises(InputError, match="frame is 320x360 but the lens is for 640x360"):
        Undistorter(lens())(np.ascontiguousarray(textured[:, ::2]))
