"""Real footage through the public function, against true cameras: what the README promises.

The full table is made by benchmarks/accuracy.py; here are its cases with fewer frames.
"""

from pathlib import Path

import cv2
import pytest

import scene4d
from references import assert_good
from scene4d.calibration import CalibrateOptions
from scene4d.core.orientation import Orientation
from scene4d.evaluation import Reference, pets, towncentre
from scene4d.video.reader import open_source
from scene4d.video.undistort import Undistorter


@pytest.fixture(scope="module")
def park(shared_data: Path) -> Reference:
    return pets(shared_data / "pets2009")


@pytest.fixture(scope="module")
def street(shared_data: Path) -> Reference:
    return towncentre(shared_data / "towncentre")


@pytest.mark.weights
def test_two_undistorted_frames_of_towncentre_with_nothing_given(
    street: Reference, shared_data: Path, tmp_path: Path
):
    """As they are, tests/cli/test_cli_evaluate.py takes them."""
    straight = Undistorter(street.camera.lens)
    with open_source(shared_data / "towncentre" / "frames") as source:
        for frame in source.frames():
            cv2.imwrite(str(tmp_path / f"{frame.index}.png"), straight(frame.image_bgr))
    assert_good(scene4d.calibrate(tmp_path), street, 0.7, undistorted=True)


def test_the_papers_method_on_tracker_boxes(street: Reference, shared_data: Path):
    data = shared_data / "towncentre"
    camera = street.camera
    found = scene4d.calibrate(
        None,
        CalibrateOptions(
            annotations=data / "tracker_boxes.txt",
            image_size=camera.image_size,
            lens=data / "TownCentre-calibration.ci",
            orientation=Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad),
            method="paper",
            drop_invalid=True,
        ),
    )
    assert found.camera is not None
    assert street.score(found.camera).mean_m <= 0.3
    assert any("left out" in warning or "dropped" in warning for warning in found.warnings)


@pytest.mark.parametrize(("name", "error_m"), [("PETS2009-S2L1.xml", 0.4), ("frcnn_det.txt", 0.8)])
def test_boxes_with_a_lens(park: Reference, shared_data: Path, name: str, error_m: float):
    data = shared_data / "pets2009"
    size = park.camera.image_size
    found = scene4d.calibrate(
        None, CalibrateOptions(annotations=data / name, image_size=size, lens=data / "View_001.xml")
    )
    assert found.camera is not None
    assert park.score(found.camera).mean_m <= error_m
    # Without a focal length boxes say nothing, and the program must not pretend.
    alone = scene4d.calibrate(None, CalibrateOptions(annotations=data / name, image_size=size))
    assert not alone
    assert alone.reason is not None
    assert "boxes alone do not determine the focal length" in alone.reason
