"""Zones and lines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import drawn, one, rows_of, stage_of, straight

from scene4d.core.errors import InputError
from scene4d.searching.predicates._zones import crosses, inside

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
NOTCHED = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [5.0, 4.0], [0.0, 10.0]])
GATE = np.array([[0.0, 0.0], [6.0, 0.0]])
EXACT = {"sigma_m": 0.0, "sigma_mps": 0.0}


def within(xy, zone=SQUARE, sigma_m=0.0, **more) -> float:
    stage = stage_of(one(xy, sigma_m=sigma_m), zones={"yard": zone})
    return float(inside(rows_of(stage, 1), zone="yard", **more)[0])


def across(path, line=GATE, **more) -> np.ndarray:
    stage = stage_of(path, lines={"gate": line})
    return crosses(rows_of(stage, 1), line="gate", **more)


def test_inside_by_hand():
    assert within((5.0, 5.0)) == pytest.approx(1.0)
    assert within((20.0, 5.0)) == pytest.approx(0.0)
    assert within((10.0, 5.0)) == pytest.approx(0.5)
    assert within((9.8, 5.0)) == pytest.approx(0.8413, abs=1e-4)
    assert within((10.2, 5.0)) == pytest.approx(0.1587, abs=1e-4)
    # 0.3 and 0.4 make 0.5.
    assert within((9.5, 5.0), sigma_m=0.4) == pytest.approx(0.8682, abs=1e-3)
    stage = stage_of(one((9.5, 5.0), sigma_m=0.4), zones={"yard": SQUARE})
    found = inside(rows_of(stage, 1), zone="yard", sigma_m=0.3)[0]
    assert found == pytest.approx(0.8413, abs=1e-4)


def test_a_notch_is_outside():
    assert within((5.0, 6.0), NOTCHED) < 0.01
    assert within((5.0, 3.0), NOTCHED) > 0.99
    assert within((1.0, 6.0), NOTCHED) > 0.99
    assert within((9.0, 6.0), NOTCHED) > 0.99


@settings(max_examples=40)
@given(st.floats(-5, 15), st.floats(-5, 15), st.floats(0, 2), st.floats(-3, 3), st.integers(0, 4))
def test_the_order_and_the_place_of_the_corners_do_not_matter(x, y, sigma, turn, first):
    expected = within((x, y), NOTCHED, sigma)
    assert 0 <= expected <= 1
    other = np.roll(NOTCHED, first, axis=0)[::-1]
    assert within((x, y), other, sigma) == pytest.approx(expected, abs=1e-9)
    closed = np.vstack([NOTCHED, NOTCHED[:1]])
    assert within((x, y), closed, sigma) == pytest.approx(expected, abs=1e-9)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, s], [-s, c]])
    turned = within(np.array([x, y]) @ rotation, NOTCHED @ rotation, sigma)
    assert turned == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("xy", [(5.0, 5.0), (9.0, 5.0), (10.5, 4.0), (3.0, -0.5), (8.2, 5.0)])
def test_it_is_the_share_of_places_inside(xy):
    path = one(xy, sigma_m=0.7)
    draws = drawn(path, 20_000, np.random.default_rng(2)).xy_m
    share = ((draws > 0) & (draws < 10)).all(axis=1).mean()
    assert within(xy, sigma_m=0.7) == pytest.approx(share, abs=0.04)


def test_crossing_has_its_peak_on_the_line():
    path = straight((3.0, -2.0), (0.0, 1.0), **EXACT)
    found = across(path)
    assert found.argmax() == 10
    assert found[10] == pytest.approx(0.9876, abs=1e-3)  # Φ(2.5) - Φ(-2.5)
    assert found[0] < 0.01
    back = across(straight((3.0, 2.0), (0.0, -1.0), **EXACT))
    np.testing.assert_allclose(back, found, atol=1e-9)


def test_over_a_walk_it_sums_to_one_crossing():
    """Windows of one step side by side hold the crossing once, however uncertain it is."""
    for sigma in (0.0, 0.5):
        path = straight((3.0, -4.0), (0.4, 1.3), 6.0, sigma_m=sigma, sigma_mps=0.0)
        assert across(path, window_s=0.2).sum() == pytest.approx(1.0, abs=0.02)
        beside = straight((8.0, -4.0), (0.0, 1.3), 6.0, sigma_m=sigma, sigma_mps=0.0)
        assert across(beside, window_s=0.2).sum() < 0.02


def test_who_stands_on_it_or_walks_along_does_not_cross():
    assert across(straight((3.0, 0.0), (0.0, 0.0), sigma_m=0.5)).max() < 1e-9
    assert across(straight((0.0, 0.0), (1.0, 0.0), sigma_m=0.5)).max() < 1e-9


def test_a_line_in_pieces_is_the_same_line():
    pieces = np.array([[0.0, 0.0], [2.0, 0.0], [2.5, 0.0], [6.0, 0.0]])
    for x in (-1.0, 0.0, 1.0, 2.0, 2.2, 5.0, 6.5):
        path = straight((x, -2.0), (0.2, 1.0), sigma_m=0.1)
        np.testing.assert_allclose(across(path, pieces), across(path), atol=1e-9)


@settings(max_examples=40)
@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 2))
def test_crossing_is_a_probability(x, y, vx, vy, sigma):
    bent = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.5], [3.0, 3.0]])
    found = across(straight((x, y), (vx, vy), 2.0, sigma_m=sigma), bent)
    assert ((found >= 0) & (found <= 1)).all()


def test_names_that_do_not_exist():
    rows = rows_of(stage_of(one(), zones={"entrance": SQUARE, "yard": SQUARE}), 1)
    with pytest.raises(InputError, match="no zone 'entrence'; did you mean 'entrance'"):
        inside(rows, zone="entrence")
    with pytest.raises(InputError, match="no line 'door'; there is gate"):
        crosses(rows_of(stage_of(one(), lines={"gate": GATE}), 1), line="door")
    with pytest.raises(InputError, match="no zone 'door'; there is none"):
        inside(rows_of(stage_of(one()), 1), zone="door")


@pytest.mark.parametrize(
    ("zone", "message"),
    [
        (SQUARE[:2], "2 points, expected at least 3"),
        (np.array([[0, 0], [1, np.nan], [1, 1.0]]), "a point is not finite"),
        (np.array([[0, 0], [1, 0], [1, 0], [1, 1.0]]), "point 3 repeats"),
    ],
)
def test_zones_that_are_none(zone, message):
    with pytest.raises(InputError, match=message):
        within((0.0, 0.0), zone)


def test_unknown_stays_unknown():
    assert np.isnan(within((np.nan, np.nan)))
    assert np.isnan(across(straight((np.nan, 0.0), (1.0, 1.0)))).all()
    empty = stage_of(one(), zones={"yard": SQUARE}).rows(np.array([], int))
    assert inside(empty, zone="yard").shape == (0,)
