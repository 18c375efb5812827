"""Together, between, alone, and staying about a place: values by hand, and draws."""

import numpy as np
import pytest
from predicate_stages import Path, drawn, one, rows_of, stage_of, straight

from scene4d.searching.predicates._crowd import alone
from scene4d.searching.predicates._distance import between
from scene4d.searching.predicates._motion import staying
from scene4d.searching.predicates._relation import together

EXACT = {"sigma_m": 1e-6, "sigma_mps": 1e-6}
DRAWS = 20_000


def of_first(function, *paths, **more) -> float:
    """The predicate of the first moment of as many objects as it takes."""
    stage = stage_of(*paths)
    rows = [stage.rows(stage.first_row[[k]]) for k in range(len(paths))]
    return float(function(*rows, **more)[0])


def test_who_goes_along_is_together_and_who_comes_against_is_not():
    here = one(velocity=(1.4, 0.0))
    beside, against = one((0.0, 1.0), (1.3, 0.1)), one((0.0, 1.0), (-1.3, 0.0))
    assert of_first(together, here, beside) > 0.95
    assert of_first(together, here, against) < 0.01
    assert of_first(together, here, one((0.0, 6.0), (1.4, 0.0))) < 0.01
    assert of_first(together, one(), one((1.0, 0.0))) > 0.95
    # At the two borders it is a half of each.
    at = one((0.0, 2.0), (1.4 - 0.7, 0.0), **EXACT)
    both = of_first(together, one(velocity=(1.4, 0.0), **EXACT), at)
    assert both == pytest.approx(0.25, abs=0.01)


def test_together_is_the_share_of_draws_that_are():
    a = one((0.0, 0.0), (1.2, 0.2), sigma_m=0.4, sigma_mps=0.3)
    b = one((1.2, 0.9), (0.9, 0.0), sigma_m=0.3, sigma_mps=0.25)
    rng = np.random.default_rng(1)
    of_a, of_b = drawn(a, DRAWS, rng), drawn(b, DRAWS, rng)
    near = np.linalg.norm(of_a.xy_m - of_b.xy_m, axis=1) < 2.0
    alike = np.linalg.norm(of_a.velocity_mps - of_b.velocity_mps, axis=1) < 0.7
    found = of_first(together, a, b, sigma_m=0.01, sigma_mps=0.01)
    assert found == pytest.approx((near & alike).mean(), abs=0.04)


@pytest.mark.parametrize(
    ("xy", "expected"),
    [((3, 0), 1.0), ((3, 1.5), 1.0), ((3, 2.0), 0.5), ((3, 4.0), 0.0), ((-1, 0), 0.0),
     ((0, 0), 0.5), ((7, 0), 0.0), ((6, 0), 0.5)],
)  # fmt: skip
def test_between_is_the_ground_between(xy, expected):
    cars = one((0.0, 0.0), name="car", **EXACT), one((6.0, 0.0), name="car", **EXACT)
    found = of_first(between, one(xy, **EXACT), *cars, sigma_m=0.05)
    assert found == pytest.approx(expected, abs=1e-3)
    swapped = of_first(between, one(xy, **EXACT), *cars[::-1], sigma_m=0.05)
    assert swapped == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("xy", [(2.0, 0.0), (1.0, 1.8), (5.5, 2.2), (0.0, 0.5)])
def test_between_is_the_share_of_draws_that_are(xy):
    paths = (
        one(xy, sigma_m=0.5),
        one((0.0, 0.0), sigma_m=0.3),
        one((6.0, 0.5), sigma_m=0.3),
    )
    rng = np.random.default_rng(2)
    a, b, c = (drawn(path, DRAWS, rng).xy_m for path in paths)
    way = (c - b) / np.linalg.norm(c - b, axis=1)[:, None]
    along = ((a - b) * way).sum(axis=1)
    off = (a - b)[:, 0] * -way[:, 1] + (a - b)[:, 1] * way[:, 0]
    inside = (along > 0) & (along < np.linalg.norm(c - b, axis=1)) & (np.abs(off) < 2.0)
    found = of_first(between, *paths, sigma_m=0.01)
    assert found == pytest.approx(inside.mean(), abs=0.03)


def test_alone_is_the_product_over_people_near():
    car = one((0.0, 0.0), name="car", **EXACT)
    at_tau = one((4.0, 0.0), **EXACT)
    away, truck = one((40.0, 0.0)), one((1.0, 0.0), name="truck")

    def of(*others):
        return float(alone(rows_of(stage_of(car, *others), 1))[0])

    assert of(away, truck) == pytest.approx(1.0)
    assert of(at_tau) == pytest.approx(0.5, abs=1e-3)
    assert of(at_tau, one((0.0, 4.0), **EXACT)) == pytest.approx(0.25, abs=1e-3)
    assert of(one((0.5, 0.0))) < 0.001
    somebody = rows_of(stage_of(one(), away), 1)
    assert alone(somebody)[0] == pytest.approx(1.0)  # nobody disturbs himself
    assert np.isnan(alone(rows_of(stage_of(one((np.nan, 0.0)), away), 1))[0])


def test_pacing_is_staying_and_walking_on_is_not():
    time = np.arange(0.0, 180.0, 0.5)
    pacing = np.column_stack([4 * np.sin(time / 6), np.zeros(len(time))])
    paces = Path(time, pacing, np.gradient(pacing, 0.5, axis=0))
    walks = straight((0.0, 0.0), (0.5, 0.0), 180.0)
    paced = staying(rows_of(stage_of(paces), 1), radius_m=8.5)
    assert paced[100:-100].min() > 0.45
    assert np.median(staying(rows_of(stage_of(paces), 1))) > 0.8
    assert staying(rows_of(stage_of(walks), 1))[200:-200].max() < 1e-6


def test_staying_knows_the_errors_of_both_ends():
    """5 m at the end of the window, each end off by 0.6 m and the word by 0.3."""
    path = Path(np.array([0.0, 30.0]), np.array([[0.0, 0.0], [5.5, 0.0]]), np.zeros((2, 2)))
    known = Path(path.time_s, path.xy_m, path.velocity_mps, sigma_m=0.6)
    found = staying(rows_of(stage_of(known), 1), sigma_m=0.3)
    assert found == pytest.approx(0.2892, abs=2e-3)  # Φ(-0.5 / √(0.3² + 2 · 0.6²))
