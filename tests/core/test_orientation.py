"""Orientation files: units, defaults, and every way to get one wrong."""

import json

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation

PLAIN = {"focal_px": 1200, "tilt_deg": 18.0, "roll_deg": -3.0}


def load(tmp_path, values) -> Orientation:
    path = tmp_path / "orientation.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return Orientation.load(path)


def test_degrees_of_the_file_are_radians_inside(tmp_path):
    found = load(tmp_path, PLAIN | {"sigma": {"focal_px": 60, "tilt_deg": 1.8, "roll_deg": 0.9}})
    assert found.focal_px == 1200
    assert found.tilt_rad == pytest.approx(0.1 * np.pi)
    assert found.roll_rad == pytest.approx(-np.pi / 60)
    assert found.focal_sigma_px == 60
    assert found.tilt_sigma_rad == pytest.approx(0.01 * np.pi)
    assert found.roll_sigma_rad == pytest.approx(0.005 * np.pi)


@pytest.mark.parametrize("sigma", [{}, {"sigma": {}}, {"sigma": None}])
def test_without_sigma_the_values_are_exact(tmp_path, sigma):
    found = load(tmp_path, PLAIN | sigma)
    assert found.focal_sigma_px == found.tilt_sigma_rad == found.roll_sigma_rad == 0


def test_one_sigma_may_be_given_alone(tmp_path):
    found = load(tmp_path, PLAIN | {"sigma": {"tilt_deg": 180}})
    assert found.tilt_sigma_rad == pytest.approx(np.pi)
    assert found.focal_sigma_px == found.roll_sigma_rad == 0


def test_an_infinite_sigma_means_unknown(tmp_path):
    found = load(tmp_path, '{"focal_px": 9, "tilt_deg": 1, "roll_deg": 0,'
                           ' "sigma": {"focal_px": Infinity}}')  # fmt: skip
    assert found.focal_sigma_px == np.inf


def test_what_the_orientation_command_writes_is_let_pass(tmp_path):
    extra = {"vfov_deg": 40, "frames": [], "sigma": {"vfov_deg": 1}, "version": "1"}
    assert load(tmp_path, PLAIN | extra).focal_px == 1200


@pytest.mark.parametrize("field", PLAIN)
def test_a_missing_field_is_named(tmp_path, field):
    values = {name: value for name, value in PLAIN.items() if name != field}
    with pytest.raises(InputError, match=f"orientation.json: field '{field}' is missing"):
        load(tmp_path, values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (PLAIN | {"focal": 3}, "unknown field 'focal'"),
        (PLAIN | {"sigma": {"tilt_rad": 1}}, "unknown field 'sigma.tilt_rad'"),
        (PLAIN | {"sigma": 3}, "field .sigma. must be an object"),
        (PLAIN | {"sigma": 0}, "field .sigma. must be an object"),
        (PLAIN | {"sigma": []}, "field .sigma. must be an object"),
        (
            PLAIN | {"sigma": {"tilt_deg": "much"}},
            "sigma.tilt_deg' must be .* at least 0, found 'much'",
        ),
        (
            PLAIN | {"sigma": {"tilt_deg": -1}},
            "sigma.tilt_deg' must be .* at least 0, found -1",
        ),
        (PLAIN | {"sigma": {"roll_deg": float("nan")}}, "'sigma.roll_deg' must be a number"),
        (PLAIN | {"focal_px": 0}, "focal_px must be positive, found 0"),
        (PLAIN | {"focal_px": -5}, "focal_px must be positive, found -5"),
        (PLAIN | {"focal_px": float("inf")}, "'focal_px' must be a number, found inf"),
        (PLAIN | {"focal_px": "wide"}, "'focal_px' must be a number, found 'wide'"),
        (PLAIN | {"focal_px": 10**400}, "'focal_px' must be a number"),
        (PLAIN | {"tilt_deg": None}, "'tilt_deg' is missing"),
        (PLAIN | {"tilt_deg": 181}, "tilt_rad must lie within ±π"),
        (PLAIN | {"roll_deg": -181}, "roll_rad must lie within ±π"),
        (PLAIN | {"tilt_deg": float("nan")}, "'tilt_deg' must be a number, found nan"),
        ([1200, 18, -3], r"must be an object, found \[1200"),
        ("", "is not JSON"),
        ("{", "is not JSON"),
        ("[" * 200_000, "is not JSON"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(tmp_path, values, message):
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, values)
    assert str(caught.value).startswith(str(tmp_path / "orientation.json"))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none.json: cannot be read: No such file"):
        Orientation.load(tmp_path / "none.json")
