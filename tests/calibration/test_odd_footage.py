"""Footage that shows no fixed, upright camera: refused, or warned of, with what helps."""

import cv2
import numpy as np
import pytest
import supervision as sv

from odd_footage import spliced, turned, write_video
from scene4d.calibration._upright import turned_footage
from scene4d.calibration.calibrating import run
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.errors import InputError
from scene4d.core.progress import Silent
from scene4d.perception.people import PeopleDetector
from scene4d.video.reader import open_source
from scene4d.video.sampling import sample_frames

PEOPLE_ONLY = CalibrateOptions(orientation="people", lines=False)


class OfGreyLevel:
    """Sees as many people as the picture's top row is bright, if no other side is bright."""

    def detect(self, image_bgr: np.ndarray) -> sv.Detections:
        rows = image_bgr.mean(axis=(1, 2))
        box = np.tile([20.0, 20.0, 40.0, 80.0], (int(rows[0]) if rows[1:].max() == 0 else 0, 1))
        return sv.Detections(box, confidence=np.ones(len(box)))


PEOPLE = PeopleDetector(OfGreyLevel())


def picture(people: int, quarters: int = 0) -> np.ndarray:
    image = np.zeros((100, 120, 3), np.uint8)
    image[0] = people
    return np.rot90(image, quarters)


@pytest.mark.parametrize(
    ("quarters", "remedy"),
    [(1, "90° clockwise"), (2, "180° (top to bottom if"), (3, "90° anticlockwise")],
)
def test_turned_footage_is_known_by_whom_it_shows_when_turned_back(quarters, remedy):
    text = turned_footage(PEOPLE, [picture(2, quarters)] * 5, whole=1, frames=40)
    assert "show 10 people from head to foot, and 0 as they are; turn the footage" in text
    assert remedy in text


def test_a_busy_an_empty_and_a_nearly_empty_street_are_upright():
    assert turned_footage(PEOPLE, [picture(2, 2)] * 5, whole=20, frames=40) is None
    assert turned_footage(PEOPLE, [picture(0)] * 5, whole=0, frames=40) is None
    assert turned_footage(PEOPLE, [picture(1, 2)] * 3, whole=0, frames=40) is None
    assert turned_footage(PEOPLE, [], whole=0, frames=40) is None


@pytest.fixture(scope="module")
def pets_images(shared_data) -> list[np.ndarray]:
    with open_source(shared_data / "pets2009" / "vtest.avi") as footage:
        return [frame.image_bgr for frame in sample_frames(footage, 10)]


def test_a_camera_mounted_upside_down(pets_images, tmp_path):
    path = write_video(tmp_path / "hanging.mp4", turned(pets_images[:3], 2))
    with pytest.raises(InputError, match=r"hanging.mp4: turned by 180°, .*, and \d as they are"):
        run(path, PEOPLE_ONLY, Silent())


def test_another_camera_at_the_end_is_left_out_and_said(pets_images, shared_data, tmp_path):
    other = cv2.imread(str(shared_data / "meva" / "frames" / "G341.jpg"))
    both = write_video(tmp_path / "both.mp4", spliced(pets_images, [other], lambda i: i == 9))
    found = run(both, PEOPLE_ONLY, Silent()).calibration
    said = "1 of 9 frames, the first at 0.9 s, show another view and were left out"
    assert found.frames == 9
    assert said in " ".join(found.warnings)
    assert found.segments.frame.max() == 8
