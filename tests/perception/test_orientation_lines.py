"""Vanishing points: wireframes of known cameras are read right, and nothing is made of nothing."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.strategies import build_camera, build_lens, ground_in_view

from scene4d.core.camera import Camera
from scene4d.perception.orientation._lines import (
    LONGEST,
    _gains,
    line_log_likelihood,
    segment_log_likelihood,
)
from scene4d.perception.orientation.grid import ROLL_RAD, SHAPE, Belief

SIZE = (640, 480)
EDGES = [(i, j) for i in range(8) for j in range(i) if bin(i ^ j).count("1") == 1]
"""A box's corners are numbered by their three binary coordinates."""
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def view(
    vfov_deg: float, tilt_deg: float, roll_deg: float, heading_deg: float, size=SIZE
) -> tuple[Camera, np.ndarray]:
    """A camera, and its roll, tilt and field of view (of the centred 4:3 crop) in radians."""
    width, height = size
    focal = min(height, width * 3 / 4) / 2 / np.tan(np.radians(vfov_deg) / 2)
    lens = build_lens(size, float(np.degrees(2 * np.arctan(width / 2 / focal))))
    camera = build_camera(lens, tilt_deg, roll_deg, 6.0, heading_deg)
    return camera, np.radians([roll_deg, tilt_deg, vfov_deg])


def boxes(camera: Camera, count: int, rng: np.random.Generator) -> np.ndarray:
    """Corners (n, 8, 3) of boxes in view, of all sizes, their sides along the world's axes."""
    foot, _ = ground_in_view(camera, rng.uniform(0.05, 0.95, (count, 2)))
    corner = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) - [0.5, 0.5, 0.0]
    away = np.linalg.norm(foot - camera.centre_m, axis=1)
    # As large in the image near and far.
    size = rng.uniform(0.3, 0.8, (count, 3)) * (away * SIZE[1] / camera.focal_px)[:, None] / 2
    return foot[:, None] + corner * size[:, None]


def wireframe(camera: Camera, count: int, seed: int) -> np.ndarray:
    """The edges (n, 4) of boxes that lie wholly in the image."""
    corners = boxes(camera, count, np.random.default_rng(seed))
    uv = camera.project(corners.reshape(-1, 3))[0].reshape(-1, 8, 2)
    edges = np.concatenate([uv[:, list(pair)].reshape(-1, 4) for pair in EDGES])
    inside = ((edges >= 0) & (edges.reshape(-1, 2, 2) < camera.image_size).reshape(-1, 4)).all(1)
    return edges[inside]


def picture(camera: Camera, count: int, seed: int) -> np.ndarray:
    """Boxes in front of each other, every face of another grey, as a camera blurs them."""
    rng = np.random.default_rng(seed)
    width, height = camera.image_size
    image = np.full((height, width, 3), 120, np.uint8)
    corners = boxes(camera, count, rng)
    faces = corners[:, FACES].reshape(-1, 4, 3)
    away = np.linalg.norm(faces - camera.centre_m, axis=2).max(axis=1)
    uv, valid = camera.project(faces.reshape(-1, 3))
    uv, valid = uv.reshape(-1, 4, 2), valid.reshape(-1, 4).all(axis=1)
    for i in np.argsort(-away):
        if valid[i] and np.abs(uv[i]).max() < 4000:
            points = np.rint(uv[i] * 16).astype(np.int32)
            grey = [int(rng.integers(30, 230))] * 3
            cv2.fillPoly(image, [points], grey, cv2.LINE_AA, shift=4)
    noisy = cv2.GaussianBlur(image, (0, 0), height / 700) + rng.normal(0, 2, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


oblique = st.builds(
    lambda quarter, rest: 90.0 * quarter + rest, st.integers(0, 3), st.floats(10.0, 80.0)
)
"""Headings that see no side of a house square on."""


def belief(segments: np.ndarray) -> Belief:
    return Belief.normalised(segment_log_likelihood(segments, SIZE))


def misses(found: Belief, truth: np.ndarray) -> np.ndarray:
    """Roll and tilt in degrees, the field of view as a share."""
    mean = found.mean()
    return np.abs([*np.degrees(mean - truth)[:2], np.log(mean[2] / truth[2])])


def spread(found: Belief, axis: int) -> float:
    low, high = found.interval(axis, 0.9)
    return np.log(high / low) if axis == 2 else np.degrees(high - low)


def scattered(count: int, seed: int) -> np.ndarray:
    """Segments anywhere, in any direction."""
    rng = np.random.default_rng(seed)
    middle, angle = rng.uniform([120, 40], [520, 440], (count, 2)), rng.uniform(0, np.pi, count)
    half = rng.uniform(10, 40, count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.hstack([middle - half, middle + half])


@settings(max_examples=25)
@given(
    vfov_deg=st.floats(25, 70),
    tilt_deg=st.floats(10, 50),
    roll_deg=st.floats(-18, 18),
    heading_deg=oblique,
    seed=st.integers(0, 1000),
)
def test_a_wireframe_gives_its_camera_away(vfov_deg, tilt_deg, roll_deg, heading_deg, seed):
    camera, truth = view(vfov_deg, tilt_deg, roll_deg, heading_deg)
    assert (misses(belief(wireframe(camera, 14, seed)), truth) < [2.5, 5, 0.25]).all()


@pytest.mark.parametrize("heading_deg", [0, 88, 180, 272])
def test_a_narrow_view_is_not_preferred_where_houses_are_seen_square_on(heading_deg):
    # Far off in one direction lie then two vanishing points, and segments fit both.
    camera, truth = view(35, 12, 12, heading_deg)
    missed = [misses(belief(wireframe(camera, 14, seed)), truth) for seed in range(6)]
    assert (np.median(missed, axis=0) < [1, 5, 0.25]).all()


@pytest.mark.parametrize("tilt_deg", [-15, -5, 0])
def test_cameras_that_look_up_are_read(tilt_deg):
    camera, truth = view(60, tilt_deg, 6, 30)
    assert (misses(belief(wireframe(camera, 20, 0)), truth) < [1.5, 3, 0.25]).all()


def test_most_wireframes_are_read_within_a_cell_of_the_grid():
    rng = np.random.default_rng(3)
    missed, inside = [], []
    for seed in range(30):
        camera, truth = view(
            rng.uniform(25, 70), rng.uniform(0, 50), rng.uniform(-18, 18), rng.uniform(0, 360)
        )
        edges = wireframe(camera, 14, seed)
        # As many segments again that follow nothing.
        found = belief(np.vstack([edges, scattered(len(edges), seed)]))
        missed.append(misses(found, truth))
        ends = np.array([found.interval(axis, 0.95) for axis in range(3)])
        inside.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
    assert (np.median(missed, axis=0) < [0.75, 1.25, 0.06]).all()
    assert (np.mean(inside, axis=0) >= 0.85).all()


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (1920, 1080), (720, 960)])
def test_a_drawn_picture_of_any_shape_is_read(size):
    camera, truth = view(45, 25, 6, 30, size)
    found = Belief.normalised(line_log_likelihood(picture(camera, 25, 1)))
    assert (misses(found, truth) < [1.0, 2.5, 0.12]).all()


def test_only_the_centred_crop_is_read():
    camera, _ = view(45, 25, 6, 30, (1280, 720))
    image = picture(camera, 25, 1)
    image[:, :160] = image[:, -160:] = np.random.default_rng(0).integers(0, 255, (720, 160, 3))
    other = image.copy()
    other[:, :160] = other[:, -160:] = 0
    np.testing.assert_array_equal(line_log_likelihood(image), line_log_likelihood(other))


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(np.zeros((480, 640, 3), np.uint8), id="black"),
        pytest.param(np.full((480, 640, 3), 255, np.uint8), id="white"),
        pytest.param(np.full((2160, 3840, 3), 90, np.uint8), id="constant and large"),
        pytest.param(np.eye(24, 32, dtype=np.uint8)[..., None].repeat(3, 2) * 255, id="tiny"),
        pytest.param(np.zeros((4, 4000, 3), np.uint8), id="a strip"),
    ],
)
def test_a_picture_without_edges_says_nothing(image):
    assert (line_log_likelihood(image) == 0).all()


@pytest.mark.parametrize("grain", [1, 6])
def test_noise_says_little(grain):
    noise = np.random.default_rng(0).integers(0, 255, (480 // grain, 640 // grain, 3), np.uint8)
    image = cv2.resize(noise, (640, 480), interpolation=cv2.INTER_CUBIC)
    found = Belief.normalised(line_log_likelihood(image))
    assert spread(found, 0) > 30
    assert spread(found, 1) > 50
    assert spread(found, 2) > np.log(5)


def test_scattered_segments_favour_no_camera():
    total = sum(segment_log_likelihood(scattered(100, seed), SIZE) for seed in range(20))
    found = Belief.normalised(total / 20)
    assert spread(found, 0) > 35
    assert spread(found, 1) > 70
    assert spread(found, 2) > np.log(7)


def test_parallel_uprights_tell_roll_and_a_level_camera_but_no_field_of_view():
    u = np.linspace(60, 580, 30)
    leaning = np.column_stack([u - 8, np.full(30, 60.0), u + 8, np.full(30, 400.0)])
    found = belief(leaning)
    up_is_to = np.degrees(np.arctan(-16 / 340))
    assert np.degrees(found.mean()[0]) == pytest.approx(up_is_to, abs=0.5)
    assert spread(found, 0) < 4
    assert spread(found, 2) > np.log(4)


def test_one_segment_proves_nothing():
    found = belief(np.array([[300.0, 100.0, 310.0, 400.0]]))
    assert spread(found, 0) > 25
    assert spread(found, 1) > 50
    assert spread(found, 2) > np.log(5)


def test_copies_of_the_same_edges_add_less_and_less():
    camera, _ = view(45, 25, 6, 30)
    edges = wireframe(camera, 14, 0)[:29]
    assert len(edges) * 4 < LONGEST
    once, twice, four_times = (
        float(np.ptp(segment_log_likelihood(np.tile(edges, (n, 1)), SIZE))) for n in (1, 2, 4)
    )
    assert once < twice < 1.9 * once
    assert twice < four_times < 1.8 * twice


def test_a_mirrored_picture_has_the_opposite_roll():
    rng = np.random.default_rng(4)
    differences = []
    for seed in range(12):
        camera, _ = view(45, rng.uniform(10, 50), rng.uniform(-15, 15), rng.uniform(0, 360))
        edges = wireframe(camera, 14, seed)
        mirrored = edges * [-1, 1, -1, 1] + [SIZE[0] - 1, 0, SIZE[0] - 1, 0]
        found, other = belief(edges).mean(), belief(mirrored).mean()
        differences.append(found - other * [-1, 1, 1])
    # Not exactly: the headings that are tried are not mirrored.
    assert (np.degrees(np.median(np.abs(differences), axis=0)) < [0.6, 1.5, 2.5]).all()


@pytest.mark.parametrize("cells", [-6, 3, 8])
def test_turning_the_picture_shifts_the_roll_by_as_much(cells):
    camera, _ = view(45, 25, 0, 30)
    edges = wireframe(camera, 14, 2)
    angle = cells * (ROLL_RAD[1] - ROLL_RAD[0])
    c, s = np.cos(angle), np.sin(angle)
    centre = (np.array(SIZE) - 1) / 2
    turned = (edges.reshape(-1, 2, 2) - centre) @ np.array([[c, s], [-s, c]]) + centre
    before = belief(edges).marginal(0)
    after = belief(turned.reshape(-1, 4)).marginal(0)
    np.testing.assert_allclose(np.roll(before, cells), after, atol=0.02)
    assert before.max() > 0.2


def test_neither_the_order_nor_the_direction_of_segments_counts():
    camera, _ = view(45, 25, 6, 30)
    edges = wireframe(camera, 8, 0)
    other = np.random.default_rng(0).permutation(edges)[:, [2, 3, 0, 1]]
    np.testing.assert_allclose(
        segment_log_likelihood(edges, SIZE), segment_log_likelihood(other, SIZE), atol=0.02
    )


def test_a_segment_is_as_likely_as_any_other_whatever_the_vanishing_point():
    # Turned about its middle all the way, it fits every place as well on average.
    angle = np.arange(0, np.pi, np.pi / 400)
    half = 0.2 * np.column_stack([np.cos(angle), np.sin(angle)])
    ends = np.array([0.3, -0.4]) + np.stack([-half, half], axis=1)
    assert np.abs(_gains(ends, 0.002).mean(axis=1)).max() < 0.01


def test_no_segments_say_nothing():
    for none in (np.empty((0, 4)), np.array([[5.0, 5.0, 5.0, 5.0]])):
        found = segment_log_likelihood(none, SIZE)
        assert found.shape == SHAPE
        assert (found == 0).all()
