"""What is told about a camera: believed where it fits, named where it does not."""

import numpy as np
import pytest
from scenes import draw_scene, solve_points

from scene4d import solve_camera
from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, people_scene

SIZE = (1920, 1080)


@pytest.fixture(scope="module")
def scene():
    camera = build_camera(build_lens(SIZE, 60.0), 20.0, 1.0, 6.0)
    people = people_scene(camera, 120, np.random.default_rng(0), noise=0.01)
    return camera, people


def told(camera, *, focal=1.0, tilt_rad=0.0, sigma=(0.0, 0.0, 0.0)) -> Orientation:
    values = camera.focal_px * focal, camera.tilt_rad + tilt_rad, camera.roll_rad
    return Orientation(*values, *sigma)


def test_what_fits_is_believed_without_a_word(scene):
    camera, people = scene
    prior = told(camera, sigma=(20.0, 0.01, 0.01))
    found = solve_camera(people.foot_uv, people.head_uv, image_size=SIZE, prior=prior)
    assert found
    assert not any("contradicts" in text for text in found.warnings)


def test_a_focal_length_that_the_people_contradict_is_named(scene):
    camera, people = scene
    prior = told(camera, focal=1.7, sigma=(30.0, np.inf, np.inf))
    found = solve_camera(people.foot_uv, people.head_uv, image_size=SIZE, prior=prior)
    said = " ".join(found.warnings) + (found.reason or "")
    assert ("focal length that was given" in said and "contradicts the people" in said) or not found


def test_a_lens_outranks_an_orientation_and_says_so(scene):
    camera, people = scene
    segments = Segments.from_points(people.foot_uv, people.head_uv)
    found = solve_points(
        segments,
        image_size=SIZE,
        lens=camera.lens,
        orientation=told(camera, focal=1.3, sigma=(10.0, np.inf, np.inf)),
    )
    assert found.camera is not None
    assert found.camera.focal_px == pytest.approx(camera.focal_px)
    assert any("differs from the lens file's" in text for text in found.warnings)


def test_a_skewed_sensor_is_read_straight():
    camera = build_camera(build_lens(SIZE, 60.0), 20.0, 1.0, 6.0)
    people = people_scene(camera, 200, np.random.default_rng(1), noise=0.005, noise_px=0.3)
    skew = np.eye(3)
    skew[0, 1] = 0.04
    skew[0, 2] = -0.04 * camera.K[1, 2]
    lens = Lens(SIZE, skew @ camera.K)

    def skewed(uv: np.ndarray) -> np.ndarray:
        return uv @ skew[:2, :2].T + skew[:2, 2]

    segments = Segments.from_points(skewed(people.foot_uv), skewed(people.head_uv))
    found = solve_points(segments, image_size=SIZE, lens=lens)
    assert found.camera is not None
    roll = np.degrees(found.camera.roll_rad - camera.roll_rad)
    assert abs(roll) < 4 * found.sigma["roll_deg"]
    uv, _ = found.camera.project(np.array([[1.0, 15.0, 0.0]]))
    straight, _ = camera.project(np.array([[1.0, 15.0, 0.0]]))
    np.testing.assert_allclose(uv, skewed(straight), atol=15)


def test_a_measured_lens_narrows_the_answer_on_real_footage(scene):
    camera, people = scene
    segments = Segments.from_points(people.foot_uv, people.head_uv)
    known = {"image_size": SIZE, "systematics": True}
    guessed = solve_points(segments, **known)
    measured = solve_points(segments, lens=camera.lens, **known)
    assert measured.sigma["height_m"] < 0.9 * guessed.sigma["height_m"]


def test_the_paper_needs_finite_spreads(scene):
    _, people = scene
    prior = Orientation(1500.0, 0.35, 0.02, np.inf, 0.0, 0.0)
    with pytest.raises(InputError, match=r"focal_px is unknown \(infinite sigma\)"):
        solve_camera(people.foot_uv, people.head_uv, image_size=SIZE, prior=prior, method="paper")


def test_the_papers_height_follows_the_orientation_it_is_told():
    """Height and orientation are drawn together: the covariance must know how they move."""
    scene = draw_scene(5, 150, image_size=SIZE, tilt_deg=20.0)
    camera, people = scene.camera, scene.people
    sigma = (0.03 * camera.focal_px, 0.01, 0.005)
    solve = {"image_size": SIZE, "method": "paper", "track": np.arange(150)}
    found = solve_camera(people.foot_uv, people.head_uv, prior=told(camera, sigma=sigma), **solve)
    assert found.covariance is not None
    rng = np.random.default_rng(0)
    heights, focals = [], []
    for _ in range(200):
        step = rng.normal(size=3) * (0.03, 0.01, 0.005)
        prior = Orientation(
            camera.focal_px * np.exp(step[0]), camera.tilt_rad + step[1], camera.roll_rad + step[2]
        )
        drawn = solve_camera(people.foot_uv, people.head_uv, prior=prior, **solve)
        if drawn.camera is not None:
            heights.append(np.log(drawn.camera.height_m))
            focals.append(step[0])
    assert len(heights) > 150
    predicted = np.sqrt(found.covariance[3, 3])
    assert 0.6 < predicted / np.std(heights) < 1.7
    correlation = found.covariance[0, 3] / np.sqrt(found.covariance[0, 0] * found.covariance[3, 3])
    assert correlation == pytest.approx(np.corrcoef(focals, heights)[0, 1], abs=0.3)
