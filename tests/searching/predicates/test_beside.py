"""Who stands within reach of a vehicle's outline, and at which side of it."""

from dataclasses import replace

import numpy as np
import pytest
from predicate_stages import STEP_S, Path, one, rows_of, stage_of

from scene4d.core.errors import InputError
from scene4d.searching.predicates._beside import beside
from scene4d.searching.predicates._motion import arrived, departs
from scene4d.searching.predicates._relation import SIDES

LENGTH_M, WIDTH_M = 5.0, 2.0


def at(place, heading_rad=0.0, sigma_rad=0.02, sigma_m=0.02, **more) -> float:
    """Somebody at a place beside a vehicle at the origin, 5 m long and 2 m wide."""
    car = one(heading=heading_rad, heading_sigma_rad=sigma_rad, name="car", sigma_m=0.02)
    stage = stage_of(one(place, sigma_m=sigma_m), car)
    size = np.array([[np.nan, np.nan, 1.7], [LENGTH_M, WIDTH_M, 1.5]])
    tracks = replace(stage.tracks, size_m=size, size_sigma_m=np.full((2, 3), 0.02))
    stage = replace(stage, tracks=tracks)
    return float(beside(rows_of(stage, 1), rows_of(stage, 2), **more)[0])


@pytest.mark.parametrize(
    ("place", "side"),
    [((3.0, 0.3), "front"), ((-3.0, -0.3), "back"), ((1.5, 1.5), "left"), ((-1.5, -1.5), "right")],
)
def test_half_a_metre_off_each_side(place, side):
    assert at(place) > 0.93
    found = {name: at(place, side=name) for name in SIDES}
    assert max(found, key=found.__getitem__) == side
    assert found[side] > 0.85
    assert sum(found.values()) == pytest.approx(at(place), abs=0.03)


def test_the_distance_is_that_of_the_outline():
    assert at((3.5, 0.0)) == pytest.approx(0.5, abs=0.01)
    assert at((0.0, 2.0)) == pytest.approx(0.5, abs=0.01)
    corner = (2.5 + np.sqrt(0.5), 1.0 + np.sqrt(0.5))
    assert at(corner) == pytest.approx(0.5, abs=0.01)
    assert at((0.0, 3.5)) < 0.01


def test_of_an_axis_either_end_may_be_the_back():
    assert at((-3.0, 0.0), side="back", sigma_rad=np.nan) == pytest.approx(0.47, abs=0.03)
    assert at((3.0, 0.0), side="back", sigma_rad=np.nan) == pytest.approx(0.47, abs=0.03)
    assert at((0.0, 1.5), side="back", sigma_rad=np.nan) < 0.02


def test_without_a_heading_it_is_the_mean_over_all_by_simulation():
    """Against headings drawn at random, places where the vehicle itself is left out."""
    rng = np.random.default_rng(1)
    for distance in (1.5, 3.0, 4.5):
        angle = rng.uniform(0, 2 * np.pi, 40_000)
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        off = np.abs(x) - LENGTH_M / 2, np.abs(y) - WIDTH_M / 2
        gap = np.hypot(np.maximum(off[0], 0), np.maximum(off[1], 0))
        noise = 0.3 * rng.normal(size=len(angle))
        # What is meant by "outside" is as soft as the reach.
        outside = np.where(gap > 0, gap, np.maximum(*off)) + 0.3 * rng.normal(size=len(angle)) > 0
        back = (off[0] > off[1]) & (x < 0) & (gap < 1.0 + noise)
        expected = back[outside].mean()
        assert at((distance, 0.0), np.nan, side="back") == pytest.approx(expected, abs=0.06)


def test_more_doubt_about_the_place_is_more_about_the_side():
    values = [at((-3.0, 0.0), side="back", sigma_m=s) for s in (0.1, 0.5, 1.5)]
    assert values == sorted(values, reverse=True)


def test_another_side_is_refused():
    with pytest.raises(InputError, match="below"):
        at((0.0, 0.0), side="below")


def test_who_came_and_who_goes():
    time = np.arange(0.0, 40.0, STEP_S)
    x = np.interp(time, [0, 10, 30, 40], [-20.0, 0, 0, 20.0])
    path = Path(time, np.column_stack([x, 0 * x]), np.zeros((len(time), 2)))
    a = rows_of(stage_of(path), 1)
    standing = (time > 10) & (time < 30)
    assert (arrived(a)[standing] > 0.95).all()
    assert (departs(a)[standing] > 0.95).all()
    assert arrived(a)[0] < 0.01
    assert departs(a)[-1] < 0.01
    soon = departs(a, window_s=5.0)
    assert (soon[standing & (time < 25)] < 0.01).all()
    assert soon[time < 5].min() > 0.95
