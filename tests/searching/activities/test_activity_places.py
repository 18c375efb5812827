"""Which polygons are zones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching.predicates._zones import check_place

SQUARE = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])


def test_simple_polygons_are_zones():
    check_place("zone", "square", SQUARE)
    check_place("zone", "closed", np.vstack([SQUARE, SQUARE[:1]]))
    check_place("zone", "clockwise", SQUARE[::-1])
    check_place("zone", "hollow", np.array([[0.0, 0], [4, 0], [4, 4], [2, 1], [0, 4]]))
    check_place("zone", "straight corner", np.array([[0.0, 0], [2, 0], [4, 0], [4, 4]]))


@pytest.mark.parametrize(
    ("corners", "says"),
    [
        (SQUARE[[0, 2, 1, 3]], "crosses itself"),
        (np.array([[0.0, 0], [4, 0], [2, 0], [4, 4]]), "crosses itself"),
        (np.array([[0.0, 0], [4, 0], [4, 4], [2, 0], [0, 4]]), "crosses itself"),
        (np.array([[0.0, 0], [4, 0], [4, 4], [0, 0], [0, 4]]), "crosses itself"),
        (SQUARE[:2], "2 points, expected at least 3"),
        (SQUARE[[0, 1, 1, 2]], "point 3 repeats the one before it"),
        (np.array([[0.0, 0], [1, 1], [np.nan, 2]]), "not finite"),
        (np.array([[0.0, 0], [1, 1], [2, 2]]), "crosses itself"),
    ],
)
def test_what_is_no_zone(corners, says):
    with pytest.raises(InputError, match="'gate'") as error:
        check_place("zone", "gate", corners)
    assert says in str(error.value)


@given(st.integers(0, 10_000), st.integers(5, 12))
def test_stars_are_zones_until_two_corners_change_places(seed, corners):
    rng = np.random.default_rng(seed)
    angle = (np.arange(corners) + rng.uniform(0.1, 0.9, corners)) * 2 * np.pi / corners
    radius = rng.uniform(1, 5, corners)
    star = 100 + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    check_place("zone", "star", star)
    i, j = sorted(rng.choice(corners, 2, replace=False))
    if (j - i) % corners in (1, corners - 1):
        return
    star[[i, j]] = star[[j, i]]
    if _crosses(star):
        with pytest.raises(InputError, match="crosses itself"):
            check_place("zone", "star", star)
    else:
        check_place("zone", "star", star)


def _crosses(corners):
    """Whether two edges meet, by solving for where; corners in general position."""
    m = len(corners)
    for i in range(m):
        for j in range(i + 2, m):
            if i == 0 and j == m - 1:
                continue
            a, b = corners[i], corners[(i + 1) % m]
            c, d = corners[j], corners[(j + 1) % m]
            s, t = np.linalg.solve(np.column_stack([b - a, c - d]), c - a)
            if 0 <= s <= 1 and 0 <= t <= 1:
                return True
    return False


def test_lines():
    check_place("line", "gate", SQUARE[:2])
    for points in (
        SQUARE[:1],
        SQUARE[[0, 0]],
        SQUARE[[0, 1, 1, 2]],
        np.array([[0.0, np.inf], [1, 1]]),
    ):
        with pytest.raises(InputError, match="'gate'"):
            check_place("line", "gate", points)
