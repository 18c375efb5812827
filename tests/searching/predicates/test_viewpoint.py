"""The same motion seen by random cameras has the same probabilities, within their stated errors.

A made-up world is put before cameras of scene4d's own kind (random height, tilt, roll, lens and
turn of the world); what is judged has gone through their pixels.
"""

from dataclasses import replace

import numpy as np
import pytest
from predicate_stages import (
    Path,
    arc,
    random_view,
    rows_of,
    seen_stage,
    stage_of,
    straight,
)

from scene4d.searching.predicates._posture import stooping
from scene4d.searching.predicates._registry import PREDICATES

CAMERAS = 4
REDRAWN = 14
NOISE_PX = 1.5
PAIRS = {
    "towards a car": (
        straight((-4.0, -1.0), (1.3, 0.4), heading_rad=np.full(21, 0.4), heading_sigma_rad=0.2),
        straight((0.0, 0.0), (0.0, 0.0), heading_rad=np.full(21, 1.2), name="car"),
    ),
    "one behind the other": (
        straight((-3.0, 0.0), (1.2, 0.1), heading_rad=np.full(21, 0.0)),
        straight((0.0, 0.5), (1.3, 0.0), heading_rad=np.full(21, 0.0)),
    ),
    "a car that turns": (
        arc(2.0, 0.35, start=(-2.0, -2.0), heading_rad=0.35 * np.arange(21) * 0.2, name="car"),
        straight((1.0, 2.0), (-0.4, -0.6), heading_rad=np.full(21, -2.0)),
    ),
}
ONE = (
    "moving", "stationary", "speed_above", "speed_below", "turning_left", "turning_right",
    "u_turning", "reversing", "inside", "crosses", "staying",
)  # fmt: skip
TWO = (
    "near", "far", "same_place", "moving_towards", "moving_away", "following", "facing",
    "together",
)  # fmt: skip
SIDES = ("front", "back", "left", "right")
ZONE = np.array([[-2.5, -2.0], [2.0, -2.0], [3.0, 1.5], [-2.0, 2.0]])
LINE = np.array([[-2.0, -3.0], [-1.0, 3.0]])


def judged(stage, places) -> dict[str, np.ndarray]:
    """Every predicate of every row, where the first half of the tracks plays a, the other b.

    Zones and lines belong to the world of the view.
    """
    with_zone = replace(stage, zones={"yard": places(ZONE)})
    with_line = replace(stage, lines={"gate": places(LINE)})
    half = np.arange(len(stage.tracks)).reshape(2, -1)
    found = {}
    for name in ONE:
        more = {"inside": {"zone": "yard"}, "crosses": {"line": "gate"}}.get(name, {})
        at = {"inside": with_zone, "crosses": with_line}.get(name, stage)
        for which, rows in zip("ab", half, strict=True):
            found[f"{name} {which}"] = PREDICATES[name].function(at.rows(rows), **more)
    a, b = (stage.rows(rows) for rows in half)
    for name in TWO:
        found[name] = PREDICATES[name].function(a, b)
    for side in SIDES:
        found[f"facing {side}"] = PREDICATES["facing"].function(a, b, side=side)
    return found


def in_view(view):
    return lambda points: view.placed(np.column_stack([points, np.zeros(len(points))]))[:, :2]


@pytest.mark.parametrize("name", PAIRS)
def test_without_noise_the_camera_does_not_matter(name):
    rng = np.random.default_rng(11)
    sure = [replace(p, sigma_m=1e-4, sigma_mps=1e-4) for p in PAIRS[name]]
    expected = judged(stage_of(*sure), lambda points: points)
    for _ in range(CAMERAS):
        view = random_view(rng)
        found = judged(seen_stage(view, *sure), in_view(view))
        for key, values in expected.items():
            np.testing.assert_allclose(found[key], values, atol=0.01, err_msg=key)


@pytest.mark.parametrize("name", PAIRS)
def test_with_noise_it_differs_by_as_much_as_its_errors_say(name):
    """The predicted error of a probability: its spread over draws with the stated covariances."""
    rng = np.random.default_rng(12)
    off, spread = [], []
    first, second = PAIRS[name]
    many = [first] * REDRAWN + [second] * REDRAWN
    for _ in range(CAMERAS):
        view = random_view(rng)
        where = in_view(view)
        true = judged(seen_stage(view, *PAIRS[name], sigma_px=NOISE_PX), where)
        drawn = judged(seen_stage(view, *many, rng=rng, sigma_px=NOISE_PX), where)
        for key, values in true.items():
            draws = drawn[key].reshape(REDRAWN, -1)
            off.append(np.abs(draws[0] - values))
            spread.append(draws[1:].std(axis=0))
    miss, predicted = np.concatenate(off), np.concatenate(spread)
    assert (miss <= 3 * predicted + 0.05).mean() > 0.97
    # On the whole the miss is as large as predicted, neither less nor more.
    assert 0.7 < np.sqrt((miss**2).mean() / (predicted**2).mean()) < 1.4


def bends(share: np.ndarray) -> Path:
    """Somebody of 1.75 m walks, and is as tall as these shares of it."""
    return replace(straight((-1.5, -1.0), (0.7, 0.5), 4.0), height_m=1.75 * share)


SHARES = {
    "stands": np.ones(21),
    "bends once": np.append(np.ones(12), [0.95, 0.9, 0.85, 0.8, 0.7, 0.7, 0.8, 0.9, 1.0]),
    "sits down": np.append(np.ones(12), np.full(9, 0.75)),
}


@pytest.mark.parametrize("name", SHARES)
def test_without_noise_stooping_is_the_same_in_every_view(name):
    """And as if seen from the side by a camera that is far away."""
    rng = np.random.default_rng(14)
    path = bends(SHARES[name])
    corner = np.tile([300.0, 200.0, 350.0, 200.0], (21, 1))
    corner[:, 3] += 250.0 * SHARES[name]
    expected = stooping(rows_of(stage_of(replace(path, box_xyxy=corner)), 1))
    for _ in range(2 * CAMERAS):
        stage = seen_stage(random_view(rng, max_tilt_deg=35.0), path)
        found = stooping(rows_of(stage, 1))
        # A hundredth of the height, where the value is steepest.
        np.testing.assert_allclose(found, expected, atol=0.07)


def test_with_noise_stooping_differs_by_as_much_as_its_errors_say():
    """Boxes whose edges are off by 2 %, or a pixel."""
    rng = np.random.default_rng(15)
    off, spread = [], []
    for path in map(bends, SHARES.values()):
        for _ in range(CAMERAS):
            view = random_view(rng, max_tilt_deg=35.0)
            true = stooping(rows_of(seen_stage(view, path, sigma_px=NOISE_PX), 1))
            drawn = seen_stage(view, *[path] * REDRAWN, rng=rng, sigma_px=NOISE_PX)
            draws = stooping(drawn.rows(np.arange(len(drawn.tracks)))).reshape(REDRAWN, -1)
            off.append(np.abs(draws[0] - true))
            spread.append(draws[1:].std(axis=0))
    miss, predicted = np.concatenate(off), np.concatenate(spread)
    assert (miss <= 3 * predicted + 0.05).mean() > 0.97
    assert 0.7 < np.sqrt((miss**2).mean() / (predicted**2).mean()) < 1.4


def test_what_is_unlike_stays_unlike_in_every_view():
    """Not by being constant: towards, away and past are told apart by all cameras."""
    rng = np.random.default_rng(13)
    car = straight((0.0, 0.0), (0.0, 0.0), name="car")
    for _ in range(CAMERAS):
        view = random_view(rng)
        found = []
        for velocity in ((1.3, 0.0), (-1.3, 0.0), (0.0, 1.3)):
            walker: Path = straight((-3.0, 0.0), velocity, 0.2)
            stage = seen_stage(view, walker, car, rng=rng, sigma_px=0.5)
            a, b = rows_of(stage, 1), rows_of(stage, 2)
            towards = PREDICATES["moving_towards"].function(a, stage.rows(b.index[: len(a)]))
            found.append(towards[0])
        assert found[0] > 0.8
        assert max(found[1:]) < 0.2
