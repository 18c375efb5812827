"""Real footage through the public function, against true cameras: what the README promises.

The full table is made by benchmarks/accuracy.py; here are its cases with fewer frames.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest

import scene4d
from scene4d.calibration import CalibrateOptions
from scene4d.core.calibration import Calibration
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


def assert_good(
    found: Calibration, reference: Reference, error_m: float, *, undistorted: bool = False
) -> None:
    assert found, found.reason
    assert found.camera is not None
    true = reference.camera
    assert reference.score(found.camera, undistorted=undistorted).mean_m <= error_m
    assert found.camera.focal_px == pytest.approx(true.focal_px, rel=0.10)
    # The stated spreads must be neither a lie nor useless.
    off = {
        "focal_px": found.camera.focal_px - true.focal_px,
        "tilt_deg": np.degrees(found.camera.tilt_rad - true.tilt_rad),
        "roll_deg": np.degrees(found.camera.roll_rad - true.roll_rad),
        "height_m": found.camera.height_m - true.height_m,
    }
    for name, value in off.items():
        assert abs(value) < 3.5 * found.sigma[name], (name, value, found.sigma)
    assert found.sigma["focal_px"] < 0.12 * true.focal_px
    assert found.ground_error_m is not None
    assert 0.05 < found.ground_error_m["median"] < 1.2


@pytest.mark.weights
def test_pets_video_with_nothing_given(park: Reference, shared_data: Path):
    found = scene4d.calibrate(shared_data / "pets2009" / "vtest.avi", CalibrateOptions(frames=24))
    assert_good(found, park, 1.0)
    assert found.frames == 24
    assert found.people > 90


@pytest.mark.weights
@pytest.mark.parametrize("undistorted", [False, True])
def test_two_frames_of_towncentre_with_nothing_given(
    street: Reference, shared_data: Path, tmp_path: Path, undistorted: bool
):
    folder = shared_data / "towncentre" / "frames"
    if undistorted:
        straight = Undistorter(street.camera.lens)
        with open_source(folder) as source:
            for frame in source.frames():
                cv2.imwrite(str(tmp_path / f"{frame.index}.png"), straight(frame.image_bgr))
        folder = tmp_path
    assert_good(scene4d.calibrate(folder), street, 0.7, undistorted=undistorted)


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
