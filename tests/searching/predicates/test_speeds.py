"""Speeds: values by hand, draws, order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import drawn, one, rows_of, stage_of

from scene4d.searching.predicates._motion import (
    moving,
    speed_above,
    speed_below,
    stationary,
)

SPEED = st.floats(0.0, 30.0)


def value(function, path, **more) -> float:
    return float(function(rows_of(stage_of(path), 1), **more)[0])


def test_values_by_hand():
    exact = {"sigma_mps": 0.001}
    assert value(speed_above, one(velocity=(2.5, 0), **exact)) == pytest.approx(0.5, abs=1e-3)
    assert value(speed_above, one(velocity=(0, 2.7), **exact)) == pytest.approx(0.8413, abs=1e-3)
    assert value(moving, one(velocity=(0.3, 0.0), **exact)) == pytest.approx(0.1587, abs=1e-3)
    # 3 and 4 make 5.
    found = value(speed_above, one(velocity=(-3, 4), **exact), speed_mps=4.8, sigma_mps=0.2)
    assert found == pytest.approx(0.8413, abs=1e-3)
    # The spread of the velocity counts as that of the word.
    found = value(speed_above, one(velocity=(5, 0), sigma_mps=0.3), speed_mps=4.5, sigma_mps=0.4)
    assert found == pytest.approx(0.8413, abs=0.01)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, 0.0), (0.5, 0.6), (3.0, -1.0)])
@pytest.mark.parametrize("sigma", [0.05, 0.4, 1.5])
def test_it_is_the_share_of_velocities_that_are_as_fast(velocity, sigma):
    path = one(velocity=velocity, sigma_mps=sigma)
    draws = drawn(path, 20_000, np.random.default_rng(1)).velocity_mps
    share = (np.hypot(*draws.T) > 0.5).mean()
    assert value(moving, path, sigma_mps=0.01) == pytest.approx(share, abs=0.05)


@settings(max_examples=40)
@given(slow=SPEED, more=st.floats(0.0, 5.0), sigma=st.floats(0.0, 3.0), at=st.floats(0.0, 20.0))
def test_faster_is_likelier_faster_and_the_rest_is_slower(slow, more, sigma, at):
    first, second = (
        value(speed_above, one(velocity=(v, 0.0), sigma_mps=sigma), speed_mps=at)
        for v in (slow, slow + more)
    )
    assert 0 <= first <= second + 1e-9 <= 1 + 1e-9
    rest = value(speed_below, one(velocity=(slow, 0.0), sigma_mps=sigma), speed_mps=at)
    assert first + rest == pytest.approx(1.0)


def test_who_does_not_move_stands():
    for v in (0.0, 0.4, 2.0):
        path = one(velocity=(v, 0.0))
        assert value(moving, path) + value(stationary, path) == pytest.approx(1.0)
    assert value(stationary, one(velocity=(0.05, 0.0))) > 0.95
    assert value(moving, one(velocity=(1.2, 0.0))) > 0.99


@pytest.mark.parametrize("function", [moving, stationary, speed_above, speed_below])
def test_unknown_stays_unknown(function):
    assert np.isnan(value(function, one(velocity=(np.nan, np.nan))))
    assert np.isnan(value(function, one(velocity=(1.0, 0.0), sigma_mps=np.nan)))
