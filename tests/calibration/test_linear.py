"""The paper's linear system: its rank as printed and as meant, and the O(N) solution of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.calibration._linear import HeightSystem, height_system, person_equations
from scene4d.core.errors import InputError
from strategies import build_camera, build_lens, cameras_over_people, people_scene

SEED = st.integers(0, 2**32 - 1)


def crowd(camera, n, rng, **kwargs):
    """Feet on the ground and heads at exactly 1.7 m over them, plus the noise asked for."""
    people = people_scene(camera, n, rng, height_sigma=0.0, noise=0.0, noise_px=0.0)
    foot, _ = camera.project(np.column_stack([people.xy_m, np.zeros(n)]))
    head, _ = camera.project(np.column_stack([people.xy_m, np.full(n, 1.7)]))
    px = kwargs.get("px", 0.0)
    return foot + px * rng.normal(size=(n, 2)), head + px * rng.normal(size=(n, 2)), people.xy_m


def paper_rows(P_columns, uv, z):
    """The two equations as printed, from P = K [R | -R C] with C = (0, 0, C_Z): coefficients of
    (C_Z, X, Y) and the right side; a..l are the first three columns of P without the height.
    """
    (a, b, c), (e, f, g), (i, j, k) = P_columns
    u, v = uv
    d, h, m = -c, -g, -k  # the fourth column per metre of C_Z
    return (
        np.array([[d - u * m, a - u * i, b - u * j], [h - v * m, e - v * i, f - v * j]]),
        np.array([z * (u * k - c), z * (v * k - g)]),
    )


def dense(camera, foot, head, height, *, shared):
    """The full system; unknowns C_Z, then (X, Y) per person (shared) or per point (printed)."""
    n, M = len(foot), camera.K @ camera.R
    blocks = n if shared else 2 * n
    A, y = np.zeros((4 * n, 1 + 2 * blocks)), np.zeros(4 * n)
    for i in range(n):
        for end, (uv, z) in enumerate(((foot[i], 0.0), (head[i], height))):
            rows, right = paper_rows(M, uv, z)
            block = i if shared else 2 * i + end
            r = slice(4 * i + 2 * end, 4 * i + 2 * end + 2)
            A[r, 0], A[r, 1 + 2 * block : 3 + 2 * block], y[r] = rows[:, 0], rows[:, 1:], right
    return A / camera.K[0, 0], y / camera.K[0, 0]


@settings(max_examples=25, deadline=None)
@given(cameras_over_people(), st.integers(2, 8), SEED)
def test_the_printed_system_leaves_the_height_free_and_the_shared_one_does_not(camera, n, seed):
    foot, head, _ = crowd(camera, n, np.random.default_rng(seed))
    printed, _ = dense(camera, foot, head, 1.7, shared=False)
    assert printed.shape == (4 * n, 4 * n + 1)
    values = np.linalg.svd(printed / np.linalg.norm(printed, axis=0), compute_uv=False)
    assert (values > 1e-12 * values[0]).sum() == 4 * n
    # The direction that nothing constrains changes the height of the camera.
    null = np.linalg.svd(printed)[2][-1]
    assert np.abs(printed @ null).max() < 1e-9
    assert abs(null[0]) > 1e-6

    shared, _ = dense(camera, foot, head, 1.7, shared=True)
    assert shared.shape == (4 * n, 2 * n + 1)
    values = np.linalg.svd(shared / np.linalg.norm(shared, axis=0), compute_uv=False)
    assert (values > 1e-12 * values[0]).sum() == 2 * n + 1


@settings(max_examples=30, deadline=None)
@given(cameras_over_people(), st.integers(1, 12), st.floats(0.0, 3.0), SEED)
def test_elimination_gives_the_dense_least_squares(camera, n, px, seed):
    foot, head, _ = crowd(camera, n, np.random.default_rng(seed), px=px)
    A, y = dense(camera, foot, head, 1.7, shared=True)
    system = height_system(camera.K, camera.R, foot, head, 1.7)
    scale = np.linalg.norm(A, axis=0)
    expected = (np.linalg.lstsq(A / scale, y, rcond=None)[0] / scale)[0]
    assert system.solve() == pytest.approx(expected, rel=1e-7)
    # Any subset is a sum over its people; a person's information is what the rest of A leaves.
    half = np.arange(n) < max(1, n // 2)
    rows = np.repeat(half, 4)
    part = np.linalg.lstsq(A[rows] / scale, y[rows], rcond=None)[0][0] / scale[0]
    some = HeightSystem(system.information[half], system.moment[half])
    assert some.solve() == pytest.approx(part, rel=1e-7)
    basis = np.linalg.qr(A[:, 1:] / scale[1:])[0]
    left = A[:, 0] - basis @ (basis.T @ A[:, 0])
    assert system.information.sum() == pytest.approx(left @ left, rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(cameras_over_people(), st.integers(1, 20), SEED)
def test_people_without_noise_give_the_height_exactly(camera, n, seed):
    foot, head, xy = crowd(camera, n, np.random.default_rng(seed))
    system = height_system(camera.K, camera.R, foot, head, 1.7)
    assert system.solve() == pytest.approx(camera.height_m, rel=1e-9)
    np.testing.assert_allclose(system.each, camera.height_m, rtol=1e-6)
    # Heights scale: people twice as tall mean a camera twice as high.
    twice = height_system(camera.K, camera.R, foot, head, 3.4)
    assert twice.solve() == pytest.approx(2 * camera.height_m, rel=1e-9)
    # And the truth solves every equation.
    a, b, c = person_equations(camera.K, camera.R, foot, head, 1.7)
    left = np.einsum("nij,nj->ni", a, xy) + b * camera.height_m
    np.testing.assert_allclose(left, c, atol=1e-9)


def test_rays_that_say_nothing_count_nothing():
    camera = build_camera(build_lens((1280, 720), 50.0), 20.0, 0.0, 6.0)
    K, R = camera.K, camera.R
    foot = np.array([[640.0, 500.0], [300.0, 400.0]])
    system = height_system(K, R, foot, foot, 1.7)  # heads where the feet are: infinitely far
    assert system.moment == pytest.approx(np.zeros(2), abs=1e-6 * system.information.max() + 1)
    none = height_system(K, R, np.empty((0, 2)), np.empty((0, 2)), 1.7)
    with pytest.raises(InputError, match="height is not determined: no usable person"):
        none.solve()


def test_a_large_crowd_needs_no_large_matrix():
    """Memory grows with N, not with N²: a dense system of 50,000 people would take 160 GB."""
    import tracemalloc

    camera = build_camera(build_lens((1280, 720), 50.0), 20.0, 0.0, 6.0)
    foot, head, _ = crowd(camera, 100, np.random.default_rng(0))
    peaks = []
    for n in (5_000, 50_000):
        rows = np.arange(n) % 100
        foot_n, head_n = foot[rows], head[rows]
        tracemalloc.start()
        assert height_system(camera.K, camera.R, foot_n, head_n, 1.7).solve() == pytest.approx(6.0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 50e6
    assert 5 < peaks[1] / peaks[0] < 15
