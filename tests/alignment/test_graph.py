"""Several cameras at once: chains, loops, and pairs that are wrong."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.test_pairs import errors, views
from alignment.worlds import made_site
from scene4d.alignment._graph import _relative, solve
from scene4d.alignment._pairs import link


@pytest.fixture(scope="module")
def street():
    site = made_site(4, cameras=3, overlap=0.6, minutes=1.5)
    seen = views(site)
    links = [link(seen[a], seen[b], (a, b)) for a, b in ((0, 1), (1, 2), (0, 2))]
    return site, seen, links


def test_a_street_of_cameras_is_one_site(street):
    site, seen, links = street
    solution = solve(seen, links)
    assert solution.groups == ((0, 1, 2),)
    assert not solution.rejected
    for one, placement in zip(site.seen[1:], solution.placements[1:], strict=True):
        apart, sigmas = errors(placement, one.truth)
        assert np.all(np.abs(sigmas) < 3.5)
        assert abs(apart[4]) < 0.15


def test_a_wrong_pair_is_thrown_out_of_the_loop(street):
    _, seen, links = street
    factor = links[2].factor
    step = np.zeros(len(factor.at))
    step[:4] = 6.0, -4.0, 1.0, 9.0
    moved = replace(factor, at=factor.at + step, vector=factor.vector + factor.information @ step)
    solution = solve(seen, [*links[:2], replace(links[2], factor=moved, found=(), score=10.0)])
    assert len(solution.rejected) == 1
    assert "contradicts" in solution.rejected[0][1]
    right = solve(seen, links[:2])
    for one, other in zip(solution.placements, right.placements, strict=True):
        np.testing.assert_allclose(one.parameters, other.parameters, atol=1e-6)


def test_a_camera_that_no_pair_joins_is_undetermined(street):
    _, seen, links = street
    solution = solve(seen, links[:1])
    assert solution.placements[1]
    assert not solution.placements[2]
    assert solution.placements[2].reason


def test_slopes_of_relative_poses(street):
    _, _, links = street
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 13))
    a[3] = 0.0
    values, slopes = _relative(links[0].factor, a, b)
    for k in range(26):
        if k == 3:
            continue  # the epoch on the site's clock is taken as known
        step = np.zeros(26)
        step[k] = 1e-6
        moved, _ = _relative(links[0].factor, a + step[:13], b + step[13:])
        np.testing.assert_allclose((moved - values) / 1e-6, slopes[:, k], atol=1e-4)
