"""Predicates of size against sampled sizes."""

from dataclasses import replace

import numpy as np
import pytest
from predicate_stages import rows_of, stage_of, straight

from scene4d.searching.predicates._looks import longer_than, taller_than

SIZE_M, SIGMA_M = np.array([6.3, 2.1, 1.9]), np.array([0.7, 0.2, 0.15])


def rows(size_m=SIZE_M, sigma_m=SIGMA_M):
    stage = stage_of(straight((0.0, 10.0), (1.0, 0.0), name="truck"))
    n = len(stage.tracks)
    tracks = replace(
        stage.tracks, size_m=np.tile(size_m, (n, 1)), size_sigma_m=np.tile(sigma_m, (n, 1))
    )
    return rows_of(replace(stage, tracks=tracks), 0)


@pytest.mark.parametrize("limit_m", [5.0, 6.0, 6.3, 7.5])
def test_the_share_of_sizes_beyond_the_limit(limit_m):
    sampled = SIZE_M + SIGMA_M * np.random.default_rng(0).normal(size=(100_000, 3))
    found = longer_than(rows(), length_m=limit_m)
    np.testing.assert_allclose(found, (sampled[:, 0] > limit_m).mean(), atol=0.005)
    found = taller_than(rows(), height_m=limit_m - 4.3)
    np.testing.assert_allclose(found, (sampled[:, 2] > limit_m - 4.3).mean(), atol=0.005)


def test_what_has_no_length_is_not_judged():
    person = rows([np.nan, np.nan, 1.7], [np.nan, np.nan, 0.05])
    assert np.isnan(longer_than(person)).all()
    assert (taller_than(person) > 0.99).all()
