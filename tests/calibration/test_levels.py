"""A second level of the ground: found where it is, kept with its height, and not made up."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import solver_points

from scene4d.calibration import solve_segments
from scene4d.calibration._body import predict_heads
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from strategies import build_camera, build_lens

SIZE = (1280, 720)
CAMERA = build_camera(build_lens(SIZE, 55.0), 24.0, 1.5, 6.0)
PEOPLE = CalibrateOptions(orientation="people")
PLATFORM_X = 1.0


def walks(
    seed: int,
    *,
    step_m: float = 0.0,
    tracks: int = 24,
    crossing: bool = True,
    small: float = 0.0,
    camera: Camera = CAMERA,
) -> tuple[Segments, np.ndarray]:
    """People who walk in view, right of ``PLATFORM_X`` on ground of another height; and who is
    there. ``small`` is by how much people who stay there are shorter (m).
    """
    rng = np.random.default_rng(seed)
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    while len(rows) < tracks:
        a, b = rng.uniform([-6, 9], [6, 24], (2, 2))
        xy = a + np.linspace(0, 1, 14)[:, None] * (b - a)
        there = xy[:, 0] > PLATFORM_X
        if not crossing and 0 < there.sum() < len(there):
            continue
        tall = rng.normal(1.70, 0.09) - small * there.all()
        z = step_m * there
        foot, ok = camera.project(np.column_stack([xy, z + 0.04]))
        head, ok_head = camera.project(np.column_stack([xy, z + tall]))
        inside = ((foot > 0) & (foot < SIZE) & (head > 0) & (head < SIZE)).all(axis=1)
        seen = ok & ok_head & inside
        if seen.sum() < 6:
            continue
        along = (head - foot)[seen]
        across = np.column_stack([-along[:, 1], along[:, 0]])
        sway = rng.normal(0, [0.02, 0.03], (len(along), 2))
        head = head[seen] + sway[:, :1] * along + sway[:, 1:] * across
        rows.append((foot[seen], head, np.full(len(head), len(rows)), there[seen]))
    foot, head, track, there = (np.concatenate(v) for v in zip(*rows, strict=True))
    segments = Segments.from_points(foot, head, track=track)
    return replace(segments, frame=np.arange(len(foot))), there


def solved(segments: Segments) -> Calibration:
    return solve_segments(segments, SIZE, PEOPLE)


@given(z=st.floats(-2.0, 2.0), height=st.floats(3.0, 12.0))
@settings(max_examples=30)
def test_a_raised_person_is_seen_as_by_a_lower_camera(z, height):
    """The model of a level against the same model of another camera, boxes included."""
    parameters = np.array([0.7, 0.4, 0.03, np.log(height), -0.02, 0.01, 0.0])
    foot, head = np.array([[700.0, 500], [300, 600]]), np.array([[700.0, 400], [310, 480]])
    points = solver_points(CAMERA, foot, head, np.array([False, True]))
    raised = predict_heads(parameters, replace(points, ground_m=np.full(2, z)), 1.7)
    lower = parameters.copy()
    lower[3] = np.log(height - z)
    plain = predict_heads(lower, points, 1.7)
    np.testing.assert_allclose(raised.head, plain.head, atol=1e-12)


@pytest.mark.parametrize("step_m", [0.8, -0.8])
def test_a_platform_is_found_with_its_height_and_its_place(step_m):
    z = []
    for seed in range(3):
        segments, there = walks(seed, step_m=step_m)
        found = solved(segments)
        (region,) = found.ground_regions
        held = region.contains(segments.foot_uv)
        majority_there = there.mean() > 0.5
        assert (held == (there != majority_there)).mean() > 0.95
        true_m = -step_m if majority_there else step_m
        assert abs(region.height_m - true_m) < 0.25 * abs(step_m)
        z.append((region.height_m - true_m) / region.sigma_m)
        assert any("second ground level" in text for text in found.warnings)
        assert found.camera is not None
        own_m = CAMERA.height_m - (step_m if majority_there else 0.0)
        assert abs(np.log(found.camera.height_m / own_m)) < 0.08
    assert 0.1 < np.sqrt(np.mean(np.square(z))) < 2.2, z


def test_positions_are_better_for_it(monkeypatch):
    """Ground points of both levels against the truth, rigid motions apart, with and without it."""
    segments, there = walks(0, step_m=1.2)
    true, _ = CAMERA.locate(segments.foot_uv, np.where(there, 1.2, 0.0) + 0.04)

    def error_m() -> float:
        found = solved(segments)
        height_m, sigma_m = found.ground_height_m(segments.foot_uv)
        assert found.camera is not None
        assert ((sigma_m > 0) == (height_m != 0)).all()
        xy, _ = found.camera.locate(segments.foot_uv, height_m + 0.04)
        a, b = (p[:, 0] + 1j * p[:, 1] for p in (xy, true))
        a, b = a - a.mean(), b - b.mean()
        turn = np.vdot(a, b)
        return float(np.median(np.abs(a * turn / abs(turn) - b)))

    with_level = error_m()
    monkeypatch.setattr("scene4d.calibration._solve.second_level", lambda *_, **__: None)
    assert with_level < 0.5
    assert error_m() > 1.5 * with_level


def test_flat_ground_has_no_second_level():
    """Some 1 % of crowds (benchmarks/levels.py): two of 10 would be a sign."""
    regions = [solved(walks(seed)[0]).ground_regions for seed in range(100, 110)]
    assert sum(map(bool, regions)) <= 1


def test_children_in_one_part_of_the_picture_are_no_level():
    for seed in range(3):
        found = solved(walks(seed, small=0.4, crossing=True)[0])
        assert not found.ground_regions


def test_a_lower_level_to_which_nobody_walks_is_a_question():
    """Feet and heads of people on it are those of shorter people on the same ground."""
    for seed in (0, 4):
        found = solved(walks(seed, step_m=-1.2, crossing=False)[0])
        assert not found.ground_regions
        assert any("children" in text for text in found.warnings)
