"""Draws of a few people: what is counted, and what is compared with what."""

import json

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.evaluation import FewPeople, Reference, few_error_m, median_m

NAN, INF = float("nan"), float("inf")


def test_refusals_and_failures_are_counted_apart():
    row = FewPeople(
        "video", 3, np.array([NAN, 1.0, 3.0, 2.0, INF]), np.array([0.5, 0.9, NAN, 2.5, 4.0])
    )
    values = row.to_dict()
    assert values["draws"] == 5 and values["people"] == 3
    assert values["nothing"] == {"refused": 1, "failed": 1, "median_m": 2.0}
    assert values["network"] == {"refused": 1, "failed": 0, "median_m": 0.9}
    # Both gave one in draws 1, 3 and 4; the guess was closer in 1 and in 4, where the other failed.
    assert values["where_both"] == {
        "draws": 3, "nothing_median_m": 2.0, "network_median_m": 2.5, "network_closer": 2,
    }  # fmt: skip


def test_a_median_that_does_not_exist_is_none_and_stays_valid_json():
    assert median_m(np.array([NAN, NAN])) is None
    assert median_m(np.array([INF, INF, 1.0])) is None
    assert median_m(np.array([1.0, INF])) == 1.0
    nobody = FewPeople("video", 10, np.array([NAN]), np.array([INF]))
    text = json.dumps(nobody.to_dict(), allow_nan=False)
    assert '"closer": 0' in text.replace("network_", "")


def test_the_error_of_a_refusal_and_of_a_camera():
    camera = Camera.from_pose(
        image_size=(640, 480), focal_px=500.0, tilt_rad=0.4, roll_rad=0.0, height_m=5.0
    )
    rng = np.random.default_rng(0)
    feet = rng.uniform([20, 150], [620, 470], (60, 2))
    truth = Reference("yard", camera, feet)
    values = {"method": "joint", "image_size": (640, 480), "person_height_m": 1.7}
    assert np.isnan(few_error_m(Calibration("undetermined", reason="no", **values), truth))
    assert few_error_m(Calibration("ok", camera=camera, **values), truth) < 1e-9
    level = Camera.from_pose(
        image_size=(640, 480), focal_px=500.0, tilt_rad=0.0, roll_rad=0.0, height_m=5.0
    )
    assert np.isinf(few_error_m(Calibration("ok", camera=level, **values), truth))
