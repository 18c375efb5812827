"""Cameras behind a fisheye lens: with a known lens, by both methods, and found by the solver."""

from dataclasses import replace

import numpy as np
import pytest

from scene4d.calibration import solve_segments
from scene4d.calibration._body import Points, predict_heads
from scene4d.calibration._lines import Lines, line_terms
from scene4d.calibration.options import POINTS, CalibrateOptions
from scene4d.core import geometry
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from strategies import FOOT_HEIGHT_M, build_camera, build_fisheye, build_lens, people_scene


def fisheye_camera(
    tilt_deg: float = 40.0, height_m: float = 3.2, focal_px: float = 420.0
) -> Camera:
    """A camera that sees 150 degrees across."""
    R = geometry.rotation_from_tilt_roll(np.radians(tilt_deg), np.radians(3))
    lens = build_fisheye((1280, 960), focal_px, (0.02, -0.005, 0.0, 0.0), centre_shift=(8.0, -5.0))
    return lens.posed(R, -R @ np.array([0.0, 0.0, height_m]))


def crowd_of(camera: Camera, seed: int = 0) -> tuple[Segments, np.ndarray]:
    """Segments in pixels of the footage, and the true ground points of the feet."""
    rng = np.random.default_rng(seed)
    people = people_scene(camera, 200, rng, tracks=30, distorted=True, height_sigma=0.05)
    return Segments.from_points(people.foot_uv, people.head_uv, track=people.track), people.xy_m


@pytest.mark.parametrize("tilt_deg", [15.0, 40.0, 60.0])
def test_a_known_fisheye_lens_is_used(tilt_deg):
    camera = fisheye_camera(tilt_deg)
    segments, xy_m = crowd_of(camera)
    found = solve_segments(segments, camera.image_size, replace(POINTS, lens=camera.lens))
    assert found and found.camera is not None and found.camera.is_fisheye, found.reason
    np.testing.assert_array_equal(found.camera.distortion, camera.distortion)
    np.testing.assert_array_equal(found.camera.K, camera.K)
    off = [found.camera.tilt_rad - camera.tilt_rad, found.camera.roll_rad - camera.roll_rad]
    off.append(np.log(found.camera.height_m / camera.height_m))
    assert found.covariance is not None
    z = np.array(off) / np.sqrt(np.diag(found.covariance)[1:4])
    assert np.abs(z).max() < 3.5
    uv, seen = camera.project(np.column_stack([xy_m, np.zeros(len(xy_m))]))
    near = seen & (np.hypot(*xy_m.T) < 12)
    assert np.hypot(*(found.camera.locate(uv)[0] - xy_m)[near].T).mean() < 0.15


def test_the_paper_s_method_undistorts_too():
    camera = fisheye_camera()
    segments, _ = crowd_of(camera)
    exact = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    options = CalibrateOptions(lens=camera.lens, orientation=exact, method="paper")
    found = solve_segments(segments, camera.image_size, options)
    assert found and found.camera is not None, found.reason
    assert found.camera.is_fisheye
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=0.05)


def test_the_distortion_alone_of_a_fisheye_lens_cannot_be_used():
    options = CalibrateOptions(lens=build_fisheye(), estimate_focal=True)
    with pytest.raises(InputError, match="estimate_focal: which way a pixel of a fisheye lens"):
        options.read((1280, 960))


# --- the solver's own fisheye lens ---


def one_coefficient(corner: float, **pose: float) -> Camera:
    """As the solver has it: square pixels, principal point in the middle, one coefficient."""
    camera = fisheye_camera(**pose)
    lens = build_fisheye(camera.image_size, camera.K[0, 0])
    focal = lens.K[0, 0] / half_diagonal(lens)
    k1 = np.array([corner * focal**2, 0.0, 0.0, 0.0])
    return replace(lens, distortion=k1).posed(camera.R, camera.t)


def half_diagonal(lens: Lens) -> float:
    return float(np.hypot(*lens.image_size)) / 2


def parameters_of(camera: Camera) -> np.ndarray:
    focal = camera.K[0, 0] / half_diagonal(camera)
    pose = [np.log(focal), camera.tilt_rad, camera.roll_rad, np.log(camera.height_m)]
    return np.array([*pose, camera.distortion[0] / focal**2, 0.0, 0.0])


def numeric(function, parameters: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences (p, ...) of a function of the parameters."""
    steps = step * np.eye(len(parameters))
    return (
        np.stack([(function(parameters + s) - function(parameters - s)) / 2 for s in steps]) / step
    )


@pytest.mark.parametrize("corner", [-0.05, 0.0, 0.04])
@pytest.mark.parametrize("tilt_deg", [10.0, 45.0, 75.0])
def test_the_model_of_heads_is_opencv_s_and_its_derivatives_are_right(corner, tilt_deg):
    camera = one_coefficient(corner, tilt_deg=tilt_deg)
    rng = np.random.default_rng(1)
    people = people_scene(
        camera, 60, rng, distorted=True, noise=0.0, noise_px=0.0, height_sigma=0.1
    )
    ends = [
        ((uv - camera.K[:2, 2]) / half_diagonal(camera)).T
        for uv in (people.foot_uv, people.head_uv)
    ]
    points = Points(*ends, np.zeros(60, bool), FOOT_HEIGHT_M, fisheye=True)
    exact = predict_heads(parameters_of(camera), points, people.height_m)
    np.testing.assert_allclose(exact.head, points.head, atol=1e-9)  # Camera.project is OpenCV's
    shifted = parameters_of(camera) + np.array([0.05, 0.02, -0.01, 0.03, 0.0, 0.02, -0.03])
    for box in (False, True):
        points = replace(points, from_box=np.full(60, box))

        def head(p: np.ndarray, points: Points = points) -> np.ndarray:
            return predict_heads(p, points, 1.7).head

        found = predict_heads(shifted, points, 1.7)
        ok = found.valid
        assert ok.sum() > 40
        expected = numeric(head, shifted)
        np.testing.assert_allclose(
            found.by_parameter[..., ok], expected[..., ok], rtol=1e-4, atol=1e-6
        )


def fisheye_edges(camera: Camera, n: int, rng: np.random.Generator) -> np.ndarray:
    """End points (n, 4) of short edges along up and two horizontal directions, as seen."""
    axes = np.array([[0, 0, 1.0], [0.8, 0.6, 0], [-0.6, 0.8, 0]])[np.arange(20 * n) % 3]
    start = rng.uniform([-8, -2, 0], [8, 15, 3], (20 * n, 3))
    ends = [camera.project(start + s * axes)[0] for s in (0.0, 0.7)]
    xyxy = np.column_stack(ends)
    last = np.tile(np.array(camera.image_size) - 1, 2)
    with np.errstate(invalid="ignore"):
        seen = ((xyxy >= 0) & (xyxy <= last)).all(axis=1)
        seen &= np.hypot(*(xyxy[:, 2:] - xyxy[:, :2]).T) > 30
    return xyxy[seen][:n] + 0.5 * rng.normal(size=(n, 4))


def test_edges_through_a_fisheye_meet_their_directions_with_right_derivatives():
    camera = one_coefficient(-0.03, tilt_deg=30.0)
    xyxy = fisheye_edges(camera, 80, np.random.default_rng(2))
    lines = Lines.from_pixels(xyxy, camera.K[:2, 2], half_diagonal(camera))
    lines = replace(lines, fisheye=True)
    truth = np.append(parameters_of(camera), np.arctan2(0.6, 0.8))
    found = line_terms(truth, lines)
    assert np.abs(found.residual).max() < 5
    assert line_terms(truth, replace(lines, fisheye=False)).cost > 10 * found.cost
    expected = numeric(lambda p: line_terms(p, lines).residual, truth)
    np.testing.assert_allclose(found.derivative, expected, rtol=1e-4, atol=1e-3)


# --- which lens it was ---

UNKNOWN = replace(POINTS, estimate_distortion=True)


def solved_unknown(camera: Camera, seed: int, *, edges: bool = False) -> Calibration:
    """Without a lens file: 150 sightings of 25 people, and 80 edges."""
    rng = np.random.default_rng(seed)
    people = people_scene(camera, 150, rng, tracks=25, distorted=True)
    segments = Segments.from_points(people.foot_uv, people.head_uv, track=people.track)
    xyxy = fisheye_edges(camera, 80, rng) if edges else None
    return solve_segments(segments, camera.image_size, UNKNOWN, edges_xyxy=xyxy)


@pytest.mark.parametrize("edges", [False, True])
def test_a_fisheye_lens_is_found(edges):
    camera = one_coefficient(-0.03, tilt_deg=35.0)
    found = solved_unknown(camera, 5, edges=edges)
    assert found and found.camera is not None, found.reason
    assert found.camera.is_fisheye
    assert any("fisheye" in text for text in found.warnings)
    assert found.camera.focal_px == pytest.approx(camera.focal_px, rel=0.05)
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=0.06)
    aside = np.array([[200.0, 650.0], [1080.0, 700.0]])  # 65 degrees off the axis
    np.testing.assert_allclose(found.camera.locate(aside)[0], camera.locate(aside)[0], atol=0.35)


@pytest.mark.parametrize(("fov_deg", "corner"), [(100.0, 0.0), (80.0, -0.08), (50.0, -0.1)])
def test_an_ordinary_lens_stays_one(fov_deg, corner):
    lens = build_lens((1280, 960), fov_deg, radial=(corner, 0.0, 0.0))
    found = solved_unknown(build_camera(lens, 30.0, 2.0, 4.0), 3, edges=True)
    assert found and found.camera is not None, found.reason
    assert not found.camera.is_fisheye
    assert found.camera.focal_px == pytest.approx(lens.K[0, 0], rel=0.05)


def test_the_uncertainty_behind_an_unknown_fisheye_holds():
    """Two-sided: stated sigmas are neither too small nor too large."""
    scores, chosen = [], 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        camera = one_coefficient(
            rng.normal(0, 0.03),
            tilt_deg=rng.uniform(20, 60),
            height_m=rng.uniform(2.8, 5.0),
            focal_px=rng.uniform(420, 620),
        )
        found = solved_unknown(camera, seed)
        assert found and found.camera is not None and found.covariance is not None, found.reason
        chosen += found.camera.is_fisheye
        off = (parameters_of(found.camera) - parameters_of(camera))[:4]
        scores.append(off / np.sqrt(np.diag(found.covariance)[:4]))
    assert chosen == 12
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert (rms > 0.5).all() and (rms < 1.6).all(), rms
