"""Calibrations: truth value, units of the uncertainty, and the fields of camera.json."""

import json

import numpy as np
import pytest

from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.camera import Camera
from scene4d.core.files import write_json
from scene4d.core.people import Segments
from strategies import build_camera, build_lens

SIGMA = np.array([0.02, 0.01, 0.005, 0.03, 0.1])
DESIGN = {
    "schema", "image_size", "K", "distortion", "R", "t", "P",
    "focal_px", "tilt_deg", "roll_deg", "height_m", "sigma", "ground_error_m",
    "method", "person_height_m", "people", "inliers", "frames", "status", "warnings",
}  # fmt: skip
"""The fields of camera.json as DESIGN.md fixes them."""


def calibration(**changes) -> Calibration:
    values = {
        "status": "ok",
        "method": "joint",
        "image_size": (1280, 720),
        "person_height_m": 1.7,
        "camera": build_camera(build_lens((1280, 720)), 20.0, -3.0, 5.0),
        "covariance": np.diag(SIGMA**2),
        "segments": Segments.from_points(np.ones((7, 2)), np.zeros((7, 2))),
        "inlier": np.array([True, False, True, True, True, False, True]),
        "ground_error_m": {"median": 0.2, "p90": 0.5},
        "warnings": ("the light is poor",),
        "frames": 40,
    }
    return Calibration(**(values | changes))


UNDETERMINED = {
    "status": "undetermined",
    "reason": "all people stand at one distance",
    "camera": None,
    "covariance": None,
    "ground_error_m": None,
}


def test_a_calibration_is_true_only_where_it_holds_a_camera():
    assert calibration()
    assert not calibration(**UNDETERMINED)


def test_fields_are_those_of_the_design():
    assert set(calibration(covariance=None).to_dict()) == DESIGN
    assert set(calibration().to_dict()) == DESIGN | {"covariance"}


def test_counts_and_facts():
    values = calibration().to_dict()
    assert values["people"] == 7
    assert values["inliers"] == 5
    assert values["frames"] == 40
    assert values["method"] == "joint"
    assert values["person_height_m"] == 1.7
    assert values["status"] == "ok"
    assert values["warnings"] == ["the light is poor"]
    assert values["ground_error_m"] == {"median": 0.2, "p90": 0.5}
    assert values["image_size"] == [1280, 720]


def test_without_segments_nobody_was_seen():
    empty = calibration(segments=None, inlier=None)
    assert empty.people == empty.inliers == 0


def test_sigma_is_in_the_units_of_the_file():
    """log f and log C_Z are relative errors; angles go from radians to degrees."""
    found = calibration().sigma
    focal = 640 / np.tan(np.radians(25))
    assert list(found) == ["focal_px", "tilt_deg", "roll_deg", "height_m"]
    assert found["focal_px"] == pytest.approx(0.02 * focal)
    assert found["tilt_deg"] == pytest.approx(0.01 * 180 / np.pi)
    assert found["roll_deg"] == pytest.approx(0.005 * 180 / np.pi)
    assert found["height_m"] == pytest.approx(0.03 * 5)
    assert calibration().to_dict()["sigma"] == found


@pytest.mark.parametrize("missing", ["camera", "covariance"])
def test_what_is_unknown_has_no_sigma(missing):
    assert calibration(**{missing: None}).sigma == {}


def test_covariance_is_written_with_the_order_of_its_rows():
    assert PARAMETERS == ("log_focal", "tilt_rad", "roll_rad", "log_height", "corner_distortion")
    values = calibration().to_dict()["covariance"]
    assert values["parameters"] == list(PARAMETERS)
    np.testing.assert_array_equal(values["matrix"], np.diag(SIGMA**2))


def test_what_is_undetermined_has_a_reason_and_no_camera():
    values = calibration(**UNDETERMINED).to_dict()
    assert values["status"] == "undetermined"
    assert values["reason"] == "all people stand at one distance"
    assert values["schema"] == "scene4d/camera/1"
    assert values["image_size"] == [1280, 720]
    assert not {"K", "R", "t", "P", "focal_px", "sigma", "covariance"} & set(values)


def test_a_camera_that_was_not_determined_is_not_written():
    """The estimate of a refused calibration may be kept for the report, never in the file."""
    refused = calibration(status="undetermined", reason="focal length unknown")
    assert not {"K", "R", "t", "P", "sigma", "ground_error_m"} & set(refused.to_dict())


def test_reason_is_written_only_where_there_is_one():
    assert "reason" not in calibration().to_dict()


def test_what_is_written_is_json_and_loads_as_the_camera(tmp_path):
    path = tmp_path / "camera.json"
    found = calibration()
    write_json(path, found.to_dict())
    assert json.loads(path.read_text()) == found.to_dict()
    np.testing.assert_array_equal(Camera.load(path).P, found.camera.P)


def test_what_is_undetermined_does_not_load_and_says_why(tmp_path):
    path = tmp_path / "camera.json"
    write_json(path, calibration(**UNDETERMINED).to_dict())
    with pytest.raises(ValueError, match="holds no camera: all people stand at one distance"):
        Camera.load(path)


def test_a_calibration_prints_in_one_line():
    camera = Camera.from_pose(
        image_size=(640, 480), focal_px=500.0, tilt_rad=0.35, roll_rad=0.0, height_m=4.0
    )
    assert repr(camera) == "<Camera 640x480: focal 500 px, tilt 20.05°, roll 0.00°, height 4.00 m>"
    known = {"method": "joint", "image_size": (640, 480), "person_height_m": 1.7}
    good = Calibration(status="ok", camera=camera, covariance=np.diag([1e-4] * 5), **known)
    assert "focal 500 ± 5 px" in repr(good) and "\n" not in repr(good)
    bad = Calibration(status="undetermined", reason="nobody was seen", **known)
    assert repr(bad) == "<Calibration undetermined: nobody was seen>"
