"""A camera's uncertainty carried to the ground: against formulas and against sampled cameras."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.ground_regions import GroundRegion
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, cameras, lenses, people_scene

STEP = st.floats(-0.1, 0.1)
CAMERA = build_camera(build_lens((1280, 720), 60.0, radial=(-0.05, 0.0, 0.0)), 25.0, 4.0, 6.0)


def pixels_of(camera: Camera, distance_m: np.ndarray) -> np.ndarray:
    """Footage pixels of ground points straight ahead."""
    ahead = camera.R[2, :2] / np.hypot(*camera.R[2, :2])
    at = camera.centre_m[:2] + np.asarray(distance_m)[:, None] * ahead
    return camera.project(np.column_stack([at, np.zeros(len(at))]))[0]


def calibration(sigma, camera: Camera = CAMERA, **changes) -> Calibration:
    scene = people_scene(
        camera, 60, np.random.default_rng(1), noise=0.0, noise_px=0.0, distorted=True
    )
    values = {
        "status": "ok",
        "method": "joint",
        "image_size": camera.image_size,
        "person_height_m": 1.7,
        "camera": camera,
        "covariance": np.diag(np.array(sigma, float) ** 2),
        "segments": Segments.from_points(scene.foot_uv, scene.head_uv),
        "inlier": np.ones(60, bool),
    }
    return Calibration(**(values | changes))


@given(camera=cameras(lenses(), anywhere=True), step=st.tuples(STEP, STEP, STEP, STEP))
def test_a_disturbed_camera_differs_by_the_step(camera, step):
    other = camera.disturbed(np.array([*step, 0.0]))
    assert other.focal_px == pytest.approx(camera.focal_px * np.exp(step[0]))
    assert other.tilt_rad == pytest.approx(camera.tilt_rad + step[1], abs=1e-9)
    assert other.roll_rad == pytest.approx(camera.roll_rad + step[2], abs=1e-9)
    assert other.height_m == pytest.approx(camera.height_m * np.exp(step[3]))
    np.testing.assert_allclose(other.centre_m[:2], camera.centre_m[:2], atol=1e-9)
    heading = [np.arctan2(c.R[2, 1], c.R[2, 0]) for c in (camera, other)]
    assert np.angle(np.exp(1j * (heading[1] - heading[0]))) == pytest.approx(0, abs=1e-9)
    np.testing.assert_array_equal(other.K[:2, 2], camera.K[:2, 2])


@given(lens=lenses(), log_f=STEP)
def test_the_lens_bends_the_sensor_alike_whatever_the_focal_length(lens, log_f):
    camera = build_camera(lens)
    other = camera.disturbed(np.array([log_f, 0.0, 0.0, 0.0, 0.0]))
    uv = np.random.default_rng(0).uniform(0, lens.image_size, (20, 2))
    np.testing.assert_allclose(other.distort(uv)[0], camera.distort(uv)[0], atol=1e-8)


@pytest.mark.parametrize("log_f", [0.0, 0.3])
def test_the_corner_moves_by_the_fraction_of_its_radius(log_f):
    camera = build_camera(build_lens((1280, 720)))
    other = camera.disturbed(np.array([log_f, 0.0, 0.0, 0.0, -0.04]))
    centre = camera.K[:2, 2]
    at_corner_radius = centre + np.hypot(640, 360) * np.array([[0.6, 0.8], [1.0, 0.0]])
    np.testing.assert_allclose(
        other.distort(at_corner_radius)[0] - centre, 0.96 * (at_corner_radius - centre), atol=1e-9
    )


TURNED = CAMERA.R @ np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
SKEWED = np.array([[900.0, 3, 600], [0, 870, 380], [0, 0, 1]])
HALF = SKEWED * [[0.5, 0.5, 1], [1, 0.5, 1], [1, 1, 1]]
LENSES = {
    "straight": Lens((1280, 720), SKEWED),
    "barrel and off centre": Lens((1280, 720), SKEWED, np.array([-0.2, 0.05, 3e-3, -2e-3, 0.01])),
    "fisheye": Lens((1280, 720), HALF, np.zeros(4), distortion_model="fisheye"),
    "bent fisheye": Lens(
        (1280, 720), HALF, np.array([-0.02, 0.01, 3e-3, -2e-3]), distortion_model="fisheye"
    ),
}


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_derivatives_are_those_of_disturbed_cameras(lens):
    """Against Richardson's extrapolation of central differences, which errs by 1e-9."""
    camera = lens.posed(TURNED, -TURNED @ np.array([3.0, -2.0, 5.0]))
    uv = np.vstack([np.random.default_rng(0).uniform((0, 200), (1280, 720), (40, 2)), HALF[:2, 2]])
    step = GroundRegion(np.array([[0.0, 500], [1280, 500], [640, 900]]), 0.7, 0.0)
    found = calibration(np.ones(7), camera, ground_regions=(step,))
    xy, jacobian, valid = found.ground_jacobian(uv)
    valid &= np.hypot(*(xy - camera.centre_m[:2]).T) < 60
    assert valid.sum() > 30
    height_m = found.ground_height_m(uv)[0]
    assert height_m[valid].any()

    def difference(way):
        ends = [camera.disturbed(sign * way).locate(uv, height_m)[0] for sign in (1, -1)]
        return (ends[0] - ends[1])[valid] / 2

    for index, axis in enumerate(np.eye(7)):
        coarse, fine = difference(2e-4 * axis) / 2e-4, difference(1e-4 * axis) / 1e-4
        expected = (4 * fine - coarse) / 3
        np.testing.assert_allclose(
            jacobian[valid, :, index], expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max()
        )


def test_an_uncertain_height_scales_the_ground():
    """σ(log C_Z) = 1 %: every ground point is off by 1 % of its distance, in its direction."""
    uv = pixels_of(CAMERA, [5.0, 10, 30])
    found = calibration([0, 0, 0, 0.01, 0])
    np.testing.assert_allclose(
        found.ground_sigma_m(uv, from_camera=True), [0.05, 0.1, 0.3], rtol=1e-5
    )
    covariance, valid = found.ground_covariance(uv, from_camera=True)
    assert valid.all()
    np.testing.assert_allclose(covariance[:, 1, 1], [0.05**2, 0.1**2, 0.3**2], rtol=1e-5)
    np.testing.assert_allclose(covariance[:, 0], 0, atol=1e-9)


def test_an_uncertain_tilt_moves_the_ground_along_the_view():
    """Y = h / tan θ for a point θ below the horizon, so dY/dθ = -h / sin² θ = -(h² + Y²) / h."""
    camera = build_camera(build_lens((1280, 720), 60.0), 25.0, 0.0, 6.0)
    distance = np.array([5.0, 10, 30])
    found = calibration([0, 0.002, 0, 0, 0], camera)
    np.testing.assert_allclose(
        found.ground_sigma_m(pixels_of(camera, distance), from_camera=True),
        0.002 * (36 + distance**2) / 6,
        rtol=1e-5,
    )


@pytest.mark.parametrize("from_camera", [False, True])
def test_sampled_cameras_spread_as_predicted(from_camera):
    """Two-sided: 400 cameras drawn from the covariance, aligned rigidly as the paper does."""
    rng = np.random.default_rng(2)
    mix = rng.normal(size=(5, 5)) * [0.004, 0.001, 0.001, 0.004, 0.002]
    covariance = mix.T @ mix
    inlier = np.arange(60) < 45
    found = calibration(np.zeros(5), covariance=covariance, inlier=inlier)
    uv = np.vstack([pixels_of(CAMERA, [6.0, 12, 25]), [[100.0, 600], [1200, 650]]])
    seen = np.vstack([found.segments.foot_uv[inlier], uv])
    truth, valid = CAMERA.locate(seen)
    assert valid.all()
    errors = []
    for step in rng.multivariate_normal(np.zeros(5), covariance, 400):
        other = CAMERA.disturbed(step)
        at, _ = other.locate(seen)
        if not from_camera:
            R, t = geometry.rigid_fit(at[:45], truth[:45])
            at = at @ R.T + t
        errors.append((at - truth)[45:])
    measured = np.sqrt(np.mean(np.sum(np.square(errors), axis=2), axis=0))
    predicted = found.ground_sigma_m(uv, from_camera=from_camera)
    np.testing.assert_allclose(measured, predicted, rtol=0.12)
    covariances, _ = found.ground_covariance(uv, from_camera=from_camera)
    for k in range(len(uv)):
        sampled = np.cov(np.array(errors)[:, k].T)
        np.testing.assert_allclose(sampled, covariances[k], atol=0.2 * predicted[k] ** 2)


def test_outliers_do_not_take_part_in_the_alignment():
    inlier = np.arange(60) < 45
    sigma = [0.004, 0.001, 0.001, 0.004, 0.002]
    uv = pixels_of(CAMERA, [6.0, 25])
    full = calibration(sigma, inlier=inlier)
    kept = calibration(sigma, segments=full.segments.select(inlier), inlier=None)
    np.testing.assert_allclose(full.ground_sigma_m(uv), kept.ground_sigma_m(uv), rtol=1e-9)
    everyone = calibration(sigma).ground_sigma_m(uv)
    assert (np.abs(full.ground_sigma_m(uv) / everyone - 1) > 1e-3).any()


def test_without_people_there_is_no_error_within_the_scene():
    uv = pixels_of(CAMERA, [6.0, 25])
    nobody = calibration([0.01] * 5, segments=None, inlier=None)
    with pytest.raises(InputError, match="where people walked"):
        nobody.ground_sigma_m(uv)
    expected = calibration([0.01] * 5).ground_sigma_m(uv, from_camera=True)
    np.testing.assert_array_equal(nobody.ground_sigma_m(uv, from_camera=True), expected)
    over, _ = nobody.ground_covariance(uv, aligned_over_uv=calibration([0.0] * 5).segments.foot_uv)
    everyone, _ = calibration([0.01] * 5).ground_covariance(uv)
    np.testing.assert_allclose(over, everyone)


def test_a_certain_camera_has_no_ground_error():
    uv = pixels_of(CAMERA, [6.0, 25])
    np.testing.assert_array_equal(calibration([0.0] * 5).ground_sigma_m(uv), 0)
    np.testing.assert_array_equal(Calibration.of_camera(CAMERA).ground_sigma_m(uv), 0)


def test_an_unknown_error_is_not_none():
    with pytest.raises(InputError, match="error of this camera is not known"):
        calibration([0.0] * 5, covariance=None).ground_sigma_m(pixels_of(CAMERA, [6.0]))


def test_one_pixel_and_pixels_through_the_lens():
    """W3: ground_sigma_m and locate speak of the same pixels."""
    found, uv = calibration([0.01] * 5), pixels_of(CAMERA, [6.0, 25])
    many = found.ground_sigma_m(uv)
    assert found.ground_sigma_m(uv[0].tolist()).shape == ()
    assert found.ground_sigma_m(uv[0]) == many[0]
    np.testing.assert_allclose(
        found.ground_sigma_m(CAMERA.undistort(uv)[0], undistorted=True), many, rtol=1e-6
    )


def test_the_sky_has_no_ground_error():
    uv = np.vstack([[[640.0, -800.0], [np.nan, 3.0]], pixels_of(CAMERA, [8.0])])
    covariance, valid = calibration([0.01] * 5).ground_covariance(uv)
    assert valid.tolist() == [False, False, True]
    assert np.isnan(covariance[:2]).all()
    assert np.isfinite(covariance[2]).all()
    sigma = calibration([0.01] * 5).ground_sigma_m(uv)
    np.testing.assert_array_equal(np.isnan(sigma), [True, True, False])


def test_no_camera_has_no_ground_error_and_says_why():
    refused = calibration([0.0] * 5, camera=CAMERA, status="undetermined", reason="one spot only")
    found = Calibration(
        status=refused.status,
        method="joint",
        image_size=(1280, 720),
        person_height_m=1.7,
        reason=refused.reason,
    )
    with pytest.raises(InputError, match="there is no camera: one spot only"):
        found.ground_sigma_m(np.zeros((1, 2)))
