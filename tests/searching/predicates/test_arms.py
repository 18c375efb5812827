"""Arms that rise and sink, from keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from predicate_stages import (
    STEP_S,
    Path,
    random_view,
    rows_of,
    stage_of,
    standing_body,
)

from scene4d.core.body import HALPE26
from scene4d.searching.predicates._body import arm_moving_down, arm_moving_up

HANGING, RAISED = np.array([0.0, 0.25, 0.80]), np.array([0.0, 0.30, 1.75])


def bodies(rate_mps: float, seconds: float = 1.6, height_m: float = 1.70, arm="left") -> np.ndarray:
    """Keypoints (t, 26, 3): one arm rises from hanging (or sinks from above) at a steady rate."""
    time = np.arange(0.0, seconds + STEP_S / 2, STEP_S)
    begin = HANGING if rate_mps >= 0 else RAISED
    wrists = begin + time[:, None] * [0.0, 0.0, rate_mps * 1.70 / height_m]
    found = np.stack([standing_body(height_m, wrist) for wrist in wrists])
    if arm == "right":
        mirrored = found[:, [HALPE26.index(_other(name)) for name in HALPE26]]
        found = mirrored * [1.0, -1.0, 1.0]
    return found


def _other(name: str) -> str:
    side, _, part = name.partition("_")
    return {"left": f"right_{part}", "right": f"left_{part}"}.get(side, name)


def flat(points: np.ndarray, scale_px: float = 100.0, turn_rad: float = 0.0) -> Path:
    """Seen from in front and afar: Y goes to the right, Z up."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    uv = points[..., 1:] * [scale_px, -scale_px] @ np.array([[c, s], [-s, c]]) + 300.0
    n = len(points)
    zero = np.zeros((n, 2))
    return Path(np.arange(n) * STEP_S, zero, zero, keypoint_uv=uv)


def values(function, path: Path, **more) -> np.ndarray:
    return function(rows_of(stage_of(path), 1), **more)


@pytest.mark.parametrize("arm", ["left", "right"])
def test_an_arm_that_rises_and_one_that_sinks(arm):
    rising, sinking, still = (flat(bodies(rate, arm=arm)) for rate in (0.8, -0.8, 0.0))
    middle = slice(1, -1)
    assert (values(arm_moving_up, rising)[middle] > 0.9).all()
    assert (values(arm_moving_down, rising)[middle] < 0.1).all()
    assert (values(arm_moving_down, sinking)[middle] > 0.9).all()
    assert (values(arm_moving_up, sinking)[middle] < 0.1).all()
    assert (values(arm_moving_up, still)[middle] < 0.1).all()
    assert (values(arm_moving_down, still)[middle] < 0.1).all()


def test_by_hand():
    """Half at the threshold; the spread of three moments 0.2 s apart and of the word."""
    assert values(arm_moving_up, flat(bodies(0.4)))[4] == pytest.approx(0.5, abs=0.03)
    noise = np.sqrt(2) * 0.02 * 1.70 / np.sqrt(2 * 0.2**2)
    assert noise == pytest.approx(0.17)
    found = values(arm_moving_up, flat(bodies(0.7)), window_s=0.4)[4]
    assert found == pytest.approx(0.8734, abs=0.003)  # Φ(0.3 / √(0.2² + 0.17²))


def test_faster_is_likelier():
    found = [values(arm_moving_up, flat(bodies(rate)))[4] for rate in np.linspace(-0.5, 1.0, 16)]
    assert (np.diff(found) > -1e-9).all()
    assert 0 <= found[0] < found[-1] <= 1


@pytest.mark.parametrize("height_m", [1.2, 1.5, 2.0])
@pytest.mark.parametrize("scale_px", [20.0, 300.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.4, np.pi])
def test_size_distance_and_roll_do_not_matter(height_m, scale_px, turn_rad):
    expected = values(arm_moving_up, flat(bodies(0.6)))
    # The same rate in heights of the body.
    tall = flat(bodies(0.6 * height_m / 1.70, height_m=height_m), scale_px, turn_rad)
    np.testing.assert_allclose(values(arm_moving_up, tall), expected, atol=1e-6)


def test_who_walks_raises_no_arm():
    path = flat(bodies(0.0))
    moved = path.keypoint_uv + np.arange(len(path))[:, None, None] * [15.0, -8.0]
    assert values(arm_moving_up, replace(path, keypoint_uv=moved))[1:-1].max() < 0.1


@pytest.mark.parametrize("rate", [0.9, -0.9])
def test_random_cameras_see_the_same_arm(rate):
    """The arm moves in the vertical plane across the line of sight, which is what a view shows."""
    rng = np.random.default_rng(6)
    expected = values(arm_moving_up, flat(bodies(rate)))
    for _ in range(20):
        view = random_view(rng, max_tilt_deg=30.0)
        away = view.shift_m @ np.array([[0.0], [1.0]])
        assert away > 5
        # The body's left and right across the view, whichever way the world is turned.
        c, s = np.cos(-view.turn_rad), np.sin(-view.turn_rad)
        across = np.array([[s, -c], [c, s]]) * rng.choice([-1.0, 1.0])
        points = bodies(rate)
        points[..., :2] = points[..., :2] @ np.array([[0.0, 1.0], [1.0, 0.0]]) @ across
        uv = view.pixels(points)
        zero = np.zeros((len(points), 2))
        path = Path(np.arange(len(points)) * STEP_S, zero, zero, keypoint_uv=uv)
        np.testing.assert_allclose(values(arm_moving_up, path), expected, atol=0.12)


def test_legs_behind_a_car_are_not_needed():
    path = flat(bodies(0.8))
    uv = path.keypoint_uv.copy()
    legs = [i for i, n in enumerate(HALPE26) if any(p in n for p in ("knee", "ankle", "toe", "he"))]
    uv[:, legs] = np.nan
    found = values(arm_moving_up, replace(path, keypoint_uv=uv))
    np.testing.assert_allclose(found, values(arm_moving_up, path), atol=0.05)


def test_a_hidden_arm_leaves_the_other_one():
    path = flat(bodies(0.8))
    uv = path.keypoint_uv.copy()
    uv[:, HALPE26.index("right_wrist")] = np.nan
    found = values(arm_moving_up, replace(path, keypoint_uv=uv))
    np.testing.assert_allclose(found, values(arm_moving_up, path))
    mirrored = flat(bodies(0.8, arm="right"))
    other = mirrored.keypoint_uv.copy()
    other[:, HALPE26.index("left_wrist")] = np.nan
    found = values(arm_moving_up, replace(mirrored, keypoint_uv=other))
    np.testing.assert_allclose(found, values(arm_moving_up, mirrored))
    uv[:, HALPE26.index("left_wrist")] = np.nan
    assert np.isnan(values(arm_moving_up, replace(path, keypoint_uv=uv))).all()


def test_without_keypoints_nothing_is_known():
    path = replace(flat(bodies(0.8)), keypoint_uv=None)
    assert np.isnan(values(arm_moving_up, path)).all()
    single = stage_of(flat(bodies(0.8)[:1]))
    assert np.isnan(arm_moving_down(rows_of(single, 1))).all()
    assert arm_moving_up(single.rows(np.array([], int))).shape == (0,)


def test_doubtful_keypoints_are_none():
    stage = stage_of(flat(bodies(0.8)))
    tracks = replace(stage.tracks, keypoint_score=0.2 * stage.tracks.keypoint_score)
    stage = replace(stage, tracks=tracks)
    assert np.isnan(arm_moving_up(rows_of(stage, 1))).all()
