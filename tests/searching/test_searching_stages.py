"""Scenes as stages: the clock, what is kept of it, and what the camera's error moves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from made_tracks import made_tracks
from scene4d.core.calibration import Calibration
from scene4d.core.tracks import Tracks
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find
from scene4d.searching.predicates.stage import Factors, Stage, ticks_of
from scene4d.searching.stages import camera_factor_of, kept_moments, stage_of, thinned
from walks import CAMERA, SIZE

SIGMA = np.array([0.02, 0.01, 0.008, 0.05, 0.0])


def known(sigma=SIGMA) -> Calibration:
    """A calibration whose errors go together."""
    mixed = np.diag(sigma) @ (0.5 * np.eye(5) + 0.5) @ np.diag(sigma)
    return replace(Calibration.of_camera(CAMERA), covariance=mixed)


def tracks_at(frames: dict[int, list[int]], fps: float = 30.0) -> Tracks:
    """Objects that stand where their number is, seen in these frames."""
    track = np.repeat(list(frames), [len(v) for v in frames.values()])
    frame = np.concatenate([np.array(v, int) for v in frames.values()])
    return made_tracks(
        track, frame / fps, np.column_stack([track, 10.0 + track]).astype(float), frame=frame,
        velocity_mps=0.0, heading_sigma_rad=1.0, box_xyxy=[10.0, 10, 20, 40],
    )  # fmt: skip


def test_every_second_moment_is_kept_of_ten_a_second():
    found, step = thinned(tracks_at({4: list(range(0, 60, 3)), 7: list(range(30, 90, 3))}), 0.2)
    assert step == pytest.approx(0.2)
    assert found.frame[found.track == 4].tolist() == list(range(0, 60, 6))
    assert found.frame[found.track == 7].tolist() == list(range(30, 90, 6))


def test_of_the_moments_about_a_step_the_nearest_is_kept():
    found, _ = thinned(tracks_at({1: list(range(56))}), 0.2)
    assert found.frame.tolist() == list(range(0, 60, 6))


def test_what_is_coarse_already_is_left_alone():
    tracks = tracks_at({1: [0, 15, 30, 45]})
    found, step = thinned(tracks, 0.2)
    assert step == pytest.approx(0.5)
    assert found.frame.tolist() == tracks.frame.tolist()


@pytest.mark.parametrize("hz", [1.0, 2.5, 4.0, 5.0])
@pytest.mark.parametrize("begin", [0.0, 0.5, 1.5, 1.0 / 3.0])
def test_wherever_it_begins_nothing_is_lost(hz, begin):
    """Of moments half a step behind the clock's zero, rounding to even would drop every other."""
    time_s = (begin + np.arange(40.0)) / hz
    kept, step = kept_moments(time_s, 0.2)
    assert kept is None
    assert step == pytest.approx(1 / hz)


@pytest.mark.parametrize("first", range(7))
def test_wherever_it_begins_every_third_of_15_a_second_is_kept(first):
    time_s = (first + np.arange(61)) / 15
    kept, step = kept_moments(time_s, 0.2)
    assert step == pytest.approx(0.2)
    assert np.flatnonzero(kept).tolist() == list(range(0, 61, 3))


@pytest.mark.parametrize(
    ("own_hz", "searched_hz"),
    [
        (30 / 3, 5),
        (30 / 1.001 / 3, 5 / 1.001),
        (60 / 1.001 / 6, 5 / 1.001),
        (24 / 1.001 / 2, 6 / 1.001),
        (25 / 2, 6.25),
        (25, 5),
        (7.5, 7.5),
        (6, 6),
        (4, 4),
    ],
)
def test_so_often_as_is_nearest_to_five_a_second(own_hz, searched_hz):
    """Footage as it is tracked, also of NTSC; of two steps as near, the shorter one."""
    time_s = 3.0 + np.arange(1201) / own_hz
    kept, step = kept_moments(time_s, 0.2)
    assert 1 / step == pytest.approx(searched_hz)
    times = time_s if kept is None else time_s[kept]
    np.testing.assert_allclose(np.diff(times), step)


def test_a_single_moment_and_none():
    assert thinned(tracks_at({1: [3]}), 0.2)[1] == 0.2
    nobody, step = thinned(tracks_at({1: [3]}).select(np.zeros(1, bool)), 0.2)
    assert len(nobody) == 0
    assert step == 0.2


@given(
    st.dictionaries(
        st.integers(0, 5),
        st.tuples(st.integers(0, 300), st.integers(2, 200)),
        min_size=1,
        max_size=5,
    ),
    st.sampled_from([1, 2, 3, 5]),
    st.floats(0.01, 1.0),
)
def test_moments_are_shared_and_a_tick_each(spans, every, step_s):
    frames = {k: list(range(a - a % every, a + n * every, every)) for k, (a, n) in spans.items()}
    tracks = tracks_at(frames)
    found, step = thinned(tracks, step_s)
    kept = set(found.time_s.tolist())
    # What is kept of one track is kept of all, and nothing else goes.
    assert found.time_s.tolist() == [t for t in tracks.time_s.tolist() if t in kept]
    own = float(np.median(np.diff(np.unique(tracks.time_s))))
    many = round(step / own)
    assert step == pytest.approx(many * own)
    # No other number of moments is nearer.
    assert all(abs(step - step_s) <= abs(k * own - step_s) + 1e-5 for k in range(1, many + 5))
    # One moment for each step of the clock: what counts steps never meets two at once.
    ticks = ticks_of(found.time_s, step)
    _, first = np.unique(found.time_s, return_index=True)
    assert len(set(ticks[first].tolist())) == len(kept)
    assert set(ticks.tolist()) == set(ticks_of(tracks.time_s, step).tolist())


def factors_at(calibration: Calibration, xy_m: np.ndarray) -> np.ndarray:
    """Those of all places, asked for at once."""
    factor = camera_factor_of(calibration)
    assert factor is not None
    return factor(xy_m)


def test_the_factor_is_a_root_of_the_ground_covariance():
    calibration = known()
    uv = np.array([[100.0, 300.0], [500.0, 250.0], [320.0, 470.0]])
    xy = CAMERA.locate(uv)[0]
    factor = factors_at(calibration, xy)
    expected, _ = calibration.ground_covariance(uv, from_camera=True)
    np.testing.assert_allclose(factor @ np.swapaxes(factor, 1, 2), expected, rtol=1e-4, atol=1e-9)


def test_the_factor_says_how_far_pairs_come_apart():
    """Against cameras drawn from the covariance: the spread of the difference of two places."""
    rng = np.random.default_rng(3)
    calibration = known(0.1 * SIGMA)
    uv = np.array([[100.0, 300.0], [500.0, 250.0]])
    factor = factors_at(calibration, CAMERA.locate(uv)[0])
    drawn = rng.multivariate_normal(np.zeros(7), calibration.covariance, 4000)
    apart = []
    for step in drawn:
        xy = CAMERA.disturbed(step).locate(uv)[0]
        apart.append(xy[1] - xy[0])
    difference = factor[1] - factor[0]
    np.testing.assert_allclose(
        difference @ difference.T, np.cov(np.array(apart).T), rtol=0.1, atol=1e-4
    )


def test_a_camera_without_a_covariance_has_no_factor():
    assert camera_factor_of(Calibration.of_camera(CAMERA)) is None
    assert camera_factor_of(replace(known(), camera=None)) is None
    assert stage_of(strewn(), Calibration.of_camera(CAMERA)).factors is None


def test_unknown_places_have_unknown_factors():
    factor = factors_at(known(), np.array([[0.0, 10.0], [np.nan, np.nan], [0.0, -50.0]]))
    assert np.isfinite(factor[0]).all()
    assert np.isnan(factor[1:]).all()


def strewn(n: int = 50) -> Tracks:
    """Rows on the ground before the camera, one of them nowhere and one behind it."""
    rng = np.random.default_rng(0)
    tracks = tracks_at({1: list(range(0, 6 * n, 6))})
    xy = rng.uniform([-10.0, 8.0], [10.0, 40.0], (n, 2))
    xy[3], xy[7] = np.nan, (0.0, -50.0)
    return replace(tracks, xy_m=xy)


@given(st.lists(st.lists(st.integers(0, 49), max_size=12), min_size=1, max_size=4))
def test_factors_that_wait_until_they_are_asked_for_are_those_of_all_rows(questions):
    """In any order, some of them twice, in this question or one before."""
    tracks = strewn()
    factors = stage_of(tracks, known()).factors
    assert isinstance(factors, Factors)
    every = factors_at(known(), tracks.xy_m)
    for rows in questions:
        at = np.array(rows, int)
        # Products are rounded, and lenses inverted, by what else is worked out with them.
        np.testing.assert_allclose(factors[at], every[at], rtol=1e-8, atol=1e-10)


def test_factors_are_worked_out_once_and_for_those_asked_for(monkeypatch):
    asked, roots = [], []
    original, eigh = Calibration.ground_jacobian, np.linalg.eigh

    def counting(calibration, uv):
        asked.append(len(uv))
        return original(calibration, uv)

    def counting_roots(covariance):
        roots.append(covariance)
        return eigh(covariance)

    monkeypatch.setattr(Calibration, "ground_jacobian", counting)
    monkeypatch.setattr(np.linalg, "eigh", counting_roots)
    stage = stage_of(strewn(), known())
    assert asked == []
    stage.rows(np.array([4, 9, 4])).camera_factor  # noqa: B018
    stage.rows(np.array([9, 20])).camera_factor  # noqa: B018
    stage.rows(np.array([20, 4])).camera_factor  # noqa: B018
    assert asked == [2, 1]
    assert len(roots) == 1


def test_the_frame_at_a_moment_that_many_share_is_that_of_the_first_row():
    tracks = tracks_at({1: [30, 36, 42], 2: [30, 36]})
    tracks = replace(tracks, frame=tracks.frame + np.where(tracks.track == 2, 1, 0))
    stage = stage_of(tracks, known())
    assert [stage.frame_at(t) for t in (1.0, 1.2, 1.4)] == [30, 36, 42]


def test_frames_of_times():
    stage = stage_of(tracks_at({1: [30, 36, 42], 2: [60, 66]}), known())
    assert stage.frame_at(1.2) == 36
    assert stage.frame_at(1.3) == 39
    assert stage.frame_at(1.7) == 51
    assert stage.frame_at(0.0) == 30
    assert stage.frame_at(9.0) == 66


def test_zones_and_lines_come_along():
    square = np.array([[0.0, 0], [1, 0], [1, 1]])
    stage = stage_of(
        tracks_at({1: [0, 3]}), known(), zones={"door": square}, lines={"gate": square}
    )
    assert set(stage.zones) == {"door"}
    assert set(stage.lines) == {"gate"}
    assert stage.image_size == SIZE


NEAR = Activity(
    "stands_together",
    (Role("person", ("person",)), Role("vehicle", ("car",))),
    (Phase("together", (Term("near", ("person", "vehicle"), {"tau_m": 4.0}),), 2.0),),
)


def staged_pair(second: str) -> Stage:
    """Two objects a metre and a half from one another, from frame 30 to 120 of 30 a second."""
    tracks = tracks_at({1: list(range(30, 121, 3)), 2: list(range(30, 121, 3))})
    kinds = np.where(tracks.track == 1, "person", second)
    return stage_of(replace(tracks, class_name=kinds), known())


def test_events_have_the_frames_of_the_footage():
    stage = staged_pair("car")
    (event,) = find(stage, NEAR)
    begin, end = stage.frame_at(event.begin_s), stage.frame_at(event.end_s)
    assert (begin, end) == (round(30 * event.begin_s), round(30 * event.end_s))
    assert 30 <= begin < end <= 120


def test_a_clip_with_nobody_for_a_role_holds_no_event():
    assert find(staged_pair("bicycle"), NEAR) == []
