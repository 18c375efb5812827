"""Near where another one was: against a comparison of every row with every spot, one by one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import Path, stage_of, with_spots

from scene4d.core.errors import InputError
from scene4d.searching.predicates._spots import Spots, near_spot
from scene4d.searching.predicates._when import DAY_S, When, Window

SPAN_S = 3000.0


@st.composite
def whens(draw) -> When:
    least_s = draw(st.sampled_from([0.0, 5.0, 300.0]))
    return When(
        least_s,
        least_s + draw(st.sampled_from([20.0, 900.0, math.inf])),
        later=draw(st.booleans()),
        is_over=draw(st.booleans()),
        day=draw(st.sampled_from([None, None, -1, 0, 1])),
        clock=draw(st.sampled_from([None, None, Window(0.0, 1200.0), Window(DAY_S - 300, 300.0)])),
    )


def asks_for(when: When, t: float, s: float) -> bool:
    """Whether a moment t speaks of a moment s, by the calendar."""
    apart = s - t if when.later else t - s
    if not when.least_s - 1e-9 <= apart <= when.most_s + 1e-9:
        return False
    night = when.clock is not None and when.clock.begin_s > when.clock.end_s
    if when.clock is not None and not when.clock.contains(float(s)):
        return False
    # A night belongs to the day on which it begins.
    shift = when.clock.end_s if night and when.day is not None else 0.0
    return when.day is None or (s - shift) // DAY_S == t // DAY_S + when.day


def fits(when: When, t: float, begin_s: float, end_s: float) -> bool:
    """Of moments a second apart; all of them where it must be over, as far as gaps are asked."""
    moments = np.append(np.arange(begin_s, end_s, 1.0), end_s)
    if when.is_over:
        gaps = begin_s - t if when.later else t - end_s
        if gaps < when.least_s or (when.later and end_s < t):
            return False
    return any(asks_for(when, t, s) for s in moments)


@settings(max_examples=60, deadline=None)
@given(whens(), st.integers(0, 10_000))
def test_when_is_as_the_calendar_says(when, seed):
    rng = np.random.default_rng(seed)
    t = DAY_S + rng.integers(-2000, 2000, 20)
    begin_s = t + rng.integers(-DAY_S * 1.4, DAY_S * 1.4, 20) * rng.choice([0.002, 0.02, 1], 20)
    begin_s = np.round(begin_s)
    end_s = begin_s + rng.integers(0, 400, 20)
    said = [fits(when, *one) for one in zip(t, begin_s, end_s, strict=True)]
    found = when.fits(t.astype(float), begin_s, end_s.astype(float))
    np.testing.assert_array_equal(found, said)
    span_s = (float(t.min()), float(t.max()))
    assert not (found & ~when.possible(span_s, begin_s, end_s.astype(float))).any()
    assert not (~found & when.always(span_s, begin_s, end_s.astype(float))).any()


def one_by_one(stage, when: When, tau_m: float, sigma_m: float) -> np.ndarray:
    """The nearest that fits, of all."""
    table, tracks = stage.spots["was"].table, stage.tracks
    found = np.zeros(len(tracks))
    for row in range(len(tracks)):
        best = math.inf
        for spot in range(len(table)):
            own = table.track[spot] == tracks.track[row] and table.run[spot] == 0
            times = tracks.time_s[row], table.begin_s[spot], table.end_s[spot]
            apart = table.xy_m[spot] - tracks.xy_m[row]
            d = float(np.hypot(*apart))
            if own or d >= best or not when.fits(*(np.array(one) for one in times)):
                continue
            best, unit = d, apart / d
            cov = table.covariance_m2[spot] + tracks.covariance_m2[row]
            spread = math.sqrt(sigma_m**2 + unit @ cov @ unit)
            p = 0.5 * math.erfc((d - tau_m) / spread / math.sqrt(2))
            found[row] = table.score[spot] * p
    return found


@settings(max_examples=12, deadline=None)
@given(whens(), st.integers(0, 10_000), st.sampled_from([3, 60]))
def test_of_all_spots_that_fit_the_nearest_counts(when, seed, spots):
    rng = np.random.default_rng(seed)
    times = [np.sort(rng.uniform(0, SPAN_S, 40)) for _ in range(3)]
    still = np.zeros((40, 2))
    paths = [Path(time_s, rng.normal(0, 6, (40, 2)), still, sigma_m=0.3) for time_s in times]
    stage = with_spots(stage_of(*paths), "was", rng, spots)
    table = replace(
        stage.spots["was"].table,
        xy_m=rng.normal(0, 6, (spots, 2)),
        run=rng.integers(0, 2, spots),
    )
    span_s = (float(stage.tracks.time_s.min()), float(stage.tracks.time_s.max()))
    seen = Spots(table, when, run=0, start_s=0.0, span_s=span_s)
    stage = replace(stage, spots={"was": seen})
    rows = stage.rows(np.arange(len(stage.tracks)))
    found = near_spot(rows, spot="was", tau_m=2.0, sigma_m=0.5)
    expected = one_by_one(stage, when, 2.0, 0.5)
    # Beyond reach it is as good as none.
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_where_the_camera_errs_alike_two_near_places_are_as_near_as_they_look():
    """Its error moves both: the same spot is the same however badly the camera is known."""
    path = Path(np.array([100.0]), np.array([[0.0, 20.0]]), np.zeros((1, 2)), sigma_m=0.01)

    def factor(xy):
        return xy[:, :, None] * 0.3

    values = []
    for one in (None, factor):
        stage = with_spots(stage_of(path, factor=one), "was", np.random.default_rng(0), 1)
        table = replace(stage.spots["was"].table, xy_m=np.array([[0.0, 21.0]]), run=np.array([1]))
        table = replace(table, begin_s=np.array([0.0]), end_s=np.array([1.0]), score=np.ones(1))
        table = replace(table, covariance_m2=np.zeros((1, 2, 2)))
        spots = Spots(table, When(), run=0, start_s=0.0, span_s=(100.0, 100.0), factor=one)
        stage = replace(stage, spots={"was": spots})
        values.append(float(near_spot(stage.rows(np.array([0])), spot="was", tau_m=2.0)[0]))
    exact, shared = values
    assert exact == pytest.approx(0.977, abs=0.002)  # 2 sigma
    assert shared == pytest.approx(0.957, abs=0.01)  # 0.3 m more along the line of a metre
    with pytest.raises(InputError, match="no spot 'is'"):
        near_spot(stage.rows(np.array([0])), spot="is")
