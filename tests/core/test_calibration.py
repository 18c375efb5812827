"""Calibrations: truth value, units of the uncertainty, and the fields of camera.json."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, people_scene

SIGMA = np.array([0.02, 0.01, 0.005, 0.03, 0.1])
DESIGN = {
    "schema", "image_size", "K", "distortion", "R", "t", "P",
    "focal_px", "tilt_deg", "roll_deg", "height_m", "sigma", "ground_error_m",
    "ground_error_from_camera_m",
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
        "ground_error_from_camera_m": {"median": 1.2, "p90": 2.5},
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
    "ground_error_from_camera_m": None,
}


def test_a_calibration_is_true_only_where_it_holds_a_camera():
    assert calibration()
    assert not calibration(**UNDETERMINED)


def test_fields_are_those_of_the_design():
    assert set(calibration(covariance=None).to_dict()) == DESIGN
    made = {"source": "yard.mp4", "version": "1.0"}
    assert set(calibration(made=made).to_dict()) == DESIGN | {"covariance", "made"}


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
    assert values["ground_error_from_camera_m"] == {"median": 1.2, "p90": 2.5}
    assert values["image_size"] == [1280, 720]


def test_without_segments_nobody_was_seen():
    empty = calibration(segments=None, inlier=None)
    assert empty.people == empty.inliers == 0


def test_sigma_is_in_the_units_of_the_file():
    """log f and log C_Z are relative errors; angles go from radians to degrees."""
    found = calibration().sigma
    focal = 640 / np.tan(np.radians(25))
    names = ["focal_px", "tilt_deg", "roll_deg", "height_m", "principal_u_px", "principal_v_px"]
    assert list(found) == names
    assert found["focal_px"] == pytest.approx(0.02 * focal)
    assert found["tilt_deg"] == pytest.approx(0.01 * 180 / np.pi)
    assert found["roll_deg"] == pytest.approx(0.005 * 180 / np.pi)
    assert found["height_m"] == pytest.approx(0.03 * 5)
    assert found["principal_u_px"] == found["principal_v_px"] == 0
    assert calibration().to_dict()["sigma"] == found


def test_sigma_alone_is_read_as_independent_errors(tmp_path):
    found = calibration()
    said = found.to_dict()
    del said["covariance"]
    write_json(tmp_path / "camera.json", said)
    loaded = Calibration.load(tmp_path / "camera.json")
    assert loaded.sigma == pytest.approx(found.sigma)
    correlation = loaded.covariance - np.diag(np.diag(loaded.covariance))
    assert not correlation.any()
    uv = np.array([[600.0, 500.0]])
    at_first, at_last = (c.ground_sigma_m(uv, from_camera=True) for c in (found, loaded))
    # A seventh parameter, the lens's, is not among the sigmas.
    assert 0.8 * at_first < at_last <= at_first


@pytest.mark.parametrize(
    ("sigma", "message"),
    [
        ({"focal_px": 90.0}, "'sigma.focal_px' must be 20, as the covariance says"),
        ({"height_m": None}, "'sigma.height_m' is missing"),
        ({"pan_deg": 1.0}, "unknown field 'sigma.pan_deg'"),
    ],
)
def test_sigma_and_covariance_that_differ_are_told(tmp_path, sigma, message):
    found = calibration()
    found = replace(found, camera=replace(found.camera, K=np.diag([1000.0, 1000.0, 1.0])))
    said = found.to_dict()
    write_json(tmp_path / "camera.json", said | {"sigma": said["sigma"] | sigma})
    with pytest.raises(InputError, match=re.escape(message)):
        Calibration.load(tmp_path / "camera.json")


@pytest.mark.parametrize("missing", ["camera", "covariance"])
def test_what_is_unknown_has_no_sigma(missing):
    assert calibration(**{missing: None}).sigma == {}


def test_covariance_is_written_with_the_order_of_its_rows():
    assert PARAMETERS[:5] == (
        "log_focal", "tilt_rad", "roll_rad", "log_height", "corner_distortion"
    )  # fmt: skip
    assert PARAMETERS[5:] == ("principal_u", "principal_v")
    values = calibration().to_dict()["covariance"]
    assert values["parameters"] == list(PARAMETERS)
    matrix = np.array(values["matrix"])
    np.testing.assert_array_equal(matrix[:5, :5], np.diag(SIGMA**2))
    assert matrix.shape == (7, 7)
    assert not matrix[5:].any()


def test_what_is_undetermined_has_a_reason_and_no_camera():
    values = calibration(**UNDETERMINED).to_dict()
    assert values["status"] == "undetermined"
    assert values["reason"] == "all people stand at one distance"
    assert values["schema"] == "scene4d/camera/2"
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
    unknown = Calibration(status="ok", camera=camera, **known)
    assert "focal 500 px" in repr(unknown) and "±" not in repr(unknown)
    bad = Calibration(status="undetermined", reason="nobody was seen", **known)
    assert repr(bad) == "<Calibration undetermined: nobody was seen>"


# The file: what is saved is loaded.

SCENE = people_scene(
    WIDE := build_camera(build_lens((1280, 720), 60.0, radial=(-0.05, 0.0, 0.0)), 25.0, 4.0, 6.0),
    300,
    np.random.default_rng(1),
    noise=0.0,
    noise_px=0.0,
    distorted=True,
)
MIX = np.random.default_rng(2).normal(size=(5, 5)) * [0.02, 0.003, 0.003, 0.02, 0.01]


def solved(**changes) -> Calibration:
    values = {
        "camera": WIDE,
        "covariance": MIX.T @ MIX,
        "segments": Segments.from_points(SCENE.foot_uv, SCENE.head_uv),
        "inlier": np.arange(300) % 5 > 0,
        "made": {"source": "yard.mp4", "command": "scene4d calibrate yard.mp4"},
    }
    return calibration(**(values | changes))


PIXELS = np.vstack([SCENE.foot_uv[:20], [[640.0, -500.0], [30.0, 700.0]]])


def test_a_loaded_calibration_answers_as_the_one_in_memory(tmp_path):
    """W1: it answered the error from the camera, and nobody had been seen."""
    found = solved()
    found.save(tmp_path / "camera.json")
    loaded = Calibration.load(tmp_path / "camera.json")
    for from_camera in (False, True):
        np.testing.assert_allclose(
            loaded.ground_sigma_m(PIXELS, from_camera=from_camera),
            found.ground_sigma_m(PIXELS, from_camera=from_camera),
            rtol=1e-12,
        )
    within, absolute = (found.ground_sigma_m(PIXELS[:20], from_camera=c) for c in (False, True))
    assert (within < 0.8 * absolute).any()  # there is something to mix up
    assert (loaded.people, loaded.inliers, loaded.frames) == (300, 240, 40)
    assert loaded.to_dict() == found.to_dict()
    np.testing.assert_array_equal(loaded.covariance, found.covariance)
    again = tmp_path / "again.json"
    loaded.save(again)
    assert again.read_text() == (tmp_path / "camera.json").read_text()
    assert repr(loaded) == repr(found)


def test_a_resized_calibration_keeps_its_error_within_the_scene(tmp_path):
    found = solved()
    found.save(tmp_path / "camera.json")
    loaded = Calibration.load(tmp_path / "camera.json")
    half = replace(loaded, camera=loaded.camera.scaled_to((640, 360)), image_size=(640, 360))
    np.testing.assert_allclose(
        half.ground_sigma_m((PIXELS[:20] + 0.5) / 2 - 0.5),
        found.ground_sigma_m(PIXELS[:20]),
        rtol=1e-6,
    )


def test_a_file_of_schema_1_has_no_error_within_the_scene(tmp_path):
    path, values = tmp_path / "camera.json", solved().to_dict()
    values["schema"] = "scene4d/camera/1"
    del values["covariance"]["scene_motion"], values["ground_error_from_camera_m"], values["made"]
    write_json(path, values)
    loaded = Calibration.load(path)
    assert (loaded.people, loaded.ground_error_m) == (300, {"median": 0.2, "p90": 0.5})
    np.testing.assert_allclose(
        loaded.ground_sigma_m(PIXELS, from_camera=True),
        solved().ground_sigma_m(PIXELS, from_camera=True),
    )
    with pytest.raises(InputError, match=r"within the scene .* from_camera=True"):
        loaded.ground_sigma_m(PIXELS)


def test_a_plain_camera_has_an_unknown_error(tmp_path):
    """W6: the camera alone has no covariance, which is not one of zeros."""
    path = tmp_path / "camera.json"
    WIDE.save(path)
    loaded = Calibration.load(path)
    assert loaded and loaded.covariance is None and loaded.sigma == {} and loaded.people == 0
    for from_camera in (False, True):
        with pytest.raises(InputError, match="error of this camera is not known"):
            loaded.ground_sigma_m(PIXELS, from_camera=from_camera)
    exact = Calibration.of_camera(WIDE)
    assert (exact.ground_sigma_m(PIXELS[:20]) == 0).all()


def test_what_is_undetermined_is_saved_with_its_reason(tmp_path):
    path = tmp_path / "camera.json"
    calibration(**UNDETERMINED).save(path)
    with pytest.raises(InputError, match="holds no camera: all people stand at one distance"):
        Calibration.load(path)


NEGATIVE = np.diag([1.0, 1, -1, 1, 1, 1, 1]).tolist()
CROOKED = (np.eye(7) + np.eye(7, k=1)).tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"person_height_m": -1}, "'person_height_m' must be a number, greater than 0, found -1"),
        ({"person_height_m": True}, "'person_height_m' must be a number.*found True"),
        ({"warnings": 5}, "'warnings' must be a list of texts, found 5"),
        ({"warnings": [5]}, "'warnings' must be a list of texts"),
        ({"method": []}, "'method' must be a text"),
        ({"people": -3}, "'people' must be a whole number, at least 0, found -3"),
        ({"inliers": 2.5}, "'inliers' must be a whole number"),
        ({"frames": "many"}, "'frames' must be a whole number"),
        ({"ground_error_m": 3}, "'ground_error_m' must be an object"),
        (
            {"ground_error_m": {"median": -1}},
            "'ground_error_m.median' must be a number, at least 0",
        ),
        ({"ground_error_from_camera_m": {"p90": 10**400}}, "'ground_error_from_camera_m.p90'"),
        ({"made": {"source": 1}}, "'made.source' must be a text"),
        ({"covariance": []}, "'covariance' must be an object"),
        ({"covariance": {"matrix": NEGATIVE}}, "'covariance.parameters' is missing"),
        ({"covariance": {"parameters": ["f"]}}, "'covariance.parameters' must be the list log_foc"),
        ({"covariance": {"parameters": PARAMETERS}}, "'covariance.matrix' is missing"),
        ({"covariance": {"parameters": PARAMETERS, "matrix": NEGATIVE}}, "no negative variance"),
        ({"covariance": {"parameters": PARAMETERS, "matrix": CROOKED}}, "symmetric"),
        ({"covariance": {"parameters": PARAMETERS, "matrix": [[1]]}}, "must be 7x7 finite numbers"),
    ],
)
def test_a_bad_field_is_named_with_its_file(tmp_path, change, message):
    """R14, R15."""
    path = tmp_path / "bad camera.json"
    path.write_text(json.dumps(solved().to_dict() | change))
    with pytest.raises(InputError, match=message) as caught:
        Calibration.load(path)
    assert str(caught.value).startswith(f"{path}: ") and len(str(caught.value)) < 400
