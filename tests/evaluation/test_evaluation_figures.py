"""Figures of an evaluation: which there are, whom they show, and that what they draw is so."""

from dataclasses import replace

import cv2
import evaluation_scenes as scenes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import report_scenes
from scene4d.core.errors import InputError
from scene4d.evaluation.measures._near import NearPairs
from scene4d.evaluation.pages._charts import auc_text, near_share, roc_curves
from scene4d.evaluation.pages._headline import headlines
from scene4d.evaluation.pages._pictures import both_grids, label_offsets
from scene4d.evaluation.pages._rings import ringed_places, true_ring
from scene4d.evaluation.pages.page import FIGURES, draw_evaluation
from scene4d.evaluation.trials.outcomes import Setting


@pytest.fixture(scope="module")
def whole():
    return scenes.whole()


@pytest.fixture(scope="module")
def drawn():
    return scenes.drawn()


ALL = [name for name in FIGURES if name not in ("ground_other", "det", "site_plan", "site_people")]


def test_all_figures_are_there_in_order(drawn):
    assert list(drawn) == ALL


@pytest.mark.parametrize("name", ALL)
def test_figures_are_pictures_and_nothing_is_cut_off(drawn, name):
    pixels = cv2.imdecode(np.frombuffer(drawn[name].png, np.uint8), cv2.IMREAD_COLOR)
    assert 700 <= pixels.shape[1] <= 1300 and 400 <= pixels.shape[0] <= 1400
    assert pixels.reshape(-1, 3).std(axis=0).min() > 10
    assert (pixels[-3:] == 255).all(), "something is cut off at the lower edge"
    assert (pixels[:, -2:] == 255).all() or pixels.shape[1] == 1260  # pictures fill the width


def test_figures_without_data_are_left_out(whole):
    nobody = tuple(scenes.refused(scenes.JOINT, "no reason"))
    assert list(draw_evaluation(replace(whole, outcomes=nobody))) == ["points"]
    joint = tuple(o for o in whole.outcomes if o.setting == scenes.JOINT)
    left = draw_evaluation(replace(whole, outcomes=joint, image_bgr=None))
    assert list(left) == ["ground_joint", "alignment", "near", "roc"]


def test_a_bare_camera_of_a_user_is_drawn():
    """As ``evaluate custom``: no people, no picture, no covariance, three points."""
    known = replace(scenes.park(), n_points=3)
    setting = Setting("camera.krtd", "given", "points.csv")
    bare = scenes.line(setting, known, scale=1.01)[0]
    assert bare.calibration is not None
    alone = replace(bare.calibration, segments=None, inlier=None, covariance=None)
    evaluation = scenes.evaluation(
        known, name="custom", outcomes=(replace(bare, calibration=alone),), image_bgr=None
    )
    assert set(draw_evaluation(evaluation)) == {"ground_other", "alignment", "near", "roc"}


def test_rings_are_within_tau_of_places_apart_from_each_other():
    known = scenes.park()
    places = ringed_places(known, 4.0)
    assert 1 <= len(places) <= 3
    there = known.locate(places)[0]
    gaps = np.hypot(*(there[:, None] - there[None]).transpose(2, 0, 1))
    assert (gaps[~np.eye(len(there), dtype=bool)] > 8).all()
    for uv, xy in zip(places, there, strict=True):
        ring, seen = known.locate(true_ring(known, uv, 4.0))
        np.testing.assert_allclose(np.hypot(*(ring[seen] - xy).T), 4.0, rtol=1e-4)
    assert len(ringed_places(known, 400.0)) == 0


def test_a_picture_of_another_size_is_refused(whole):
    with pytest.raises(InputError, match=r"\(576, 768, 3\)"):
        draw_evaluation(replace(whole, image_bgr=np.zeros((10, 10, 3), np.uint8)))


def test_headlines_are_the_first_that_count_and_not_the_best(whole):
    paper, joint = headlines(whole)
    assert (paper.setting, paper.person_height_m) == (scenes.PAPER, 1.7018)
    assert (joint.setting, joint.person_height_m) == (scenes.JOINT, 1.70)
    # The circular line comes first and is exact, so the rule is seen to look past it.
    circular = [o for o in whole.outcomes if o.setting.circular]
    assert min(o.score.error.mean_m for o in circular) < 1e-6 < joint.score.error.mean_m
    better = Setting("better", "joint", "lens")
    more = replace(
        whole, outcomes=(*whole.outcomes, *scenes.line(better, whole.reference, focal=1.01))
    )
    assert headlines(more)[1].setting == scenes.JOINT


def test_the_lines_to_show_are_marked_before_anything_is_measured():
    """The marked line where it has a result, whoever scores better; else the first that has one."""
    known = scenes.park()
    lines = {
        (footage, method): Setting(footage, method, "lens", headline=footage == "marked")
        for footage in ("first", "marked")
        for method in ("paper", "joint")
    }
    outcomes = (
        *scenes.line(lines["first", "paper"], known, scale=1.01),
        *scenes.line(lines["first", "joint"], known, focal=1.01),
        *scenes.refused(lines["marked", "paper"], "only 2 people agree"),
        *scenes.line(lines["marked", "joint"], known, focal=1.08),
    )
    shown = headlines(scenes.evaluation(known, outcomes=outcomes))
    assert [s.setting.footage for s in shown] == ["first", "marked"]


def test_a_line_that_was_refused_at_the_wanted_height_gives_way(whole):
    gone = [
        replace(o, score=None, reason="gone")
        if o.setting == scenes.PAPER and o.person_height_m == 1.7018
        else o
        for o in whole.outcomes
    ]
    assert [s.method for s in headlines(replace(whole, outcomes=tuple(gone)))] == ["joint"]


@pytest.mark.parametrize("turn", [0.0, 1.1])
@pytest.mark.parametrize("ground_only", [False, True])
def test_the_true_grid_lies_on_the_estimated_one_only_where_the_camera_is_right(turn, ground_only):
    camera = scenes.truth(turn)
    if ground_only:
        camera = replace(camera, distortion=np.zeros(5))
        known = replace(scenes.reference(camera), truth=scenes.ground_map(camera))
    else:
        known = scenes.reference(camera)
    lens = np.zeros(5) if ground_only else camera.distortion

    def apart(focal: float) -> float:
        estimate = report_scenes.camera(distortion=lens, focal_px=focal)
        shown = scenes.outcome(scenes.JOINT, 1.70, known, estimate)
        evaluation = scenes.evaluation(known, outcomes=(shown,))
        lines, true, _ = both_grids(known, headlines(evaluation)[0])
        assert len(lines) == len(true) > 4
        gaps = [np.linalg.norm(a.uv - b, axis=1) for a, b in zip(lines, true, strict=True)]
        return float(np.nanmax(np.concatenate(gaps)))

    assert apart(1185.0) < 1e-3
    assert apart(1.1 * 1185.0) > 5


def test_the_share_of_near_pairs_by_hand():
    # Thirty pairs at 2.05 m, all near; thirty at 4.05 m, a third; ten at 6 m, too few.
    estimated = np.repeat([2.05, 4.05, 6.0], [30, 30, 10])
    true = np.concatenate([np.full(30, 2.0), np.full(10, 3.9), np.full(20, 4.1), np.full(10, 6.0)])
    share = near_share(NearPairs(true, estimated, np.zeros(70)))
    np.testing.assert_allclose(share.distance_m, [2.05, 4.05])
    np.testing.assert_allclose(share.share, [1, 1 / 3])
    assert share.count.tolist() == [30, 30]
    # From 1 to 1/3 over two metres: one half is passed three quarters of the way.
    assert share.falls_below(0.5) == pytest.approx(2.05 + 0.75 * 2)
    assert share.falls_below(0.2) is None


def test_a_pair_beyond_the_horizon_is_never_near():
    pairs = NearPairs(np.full(50, 2.0), np.append(np.full(30, 1.05), [np.inf] * 20), np.zeros(50))
    assert near_share(pairs).count.tolist() == [30]


def test_the_curves_are_those_of_the_papers_heights(whole):
    for shown in headlines(whole):
        curves = roc_curves(whole, shown)
        assert [height for height, _ in curves] == [1.5748, 1.7018, 1.8288]
        by_height = {o.person_height_m: o.score.near.auc for o in whole.of(shown.setting)}
        assert [roc.auc for _, roc in curves] == [by_height[height] for height, _ in curves]


def test_an_auc_that_is_not_one_is_not_shown_as_one():
    assert auc_text(1.0) == "1.0000"
    assert auc_text(0.99999) == ">\u00a00.9999"
    assert auc_text(0.98765) == "0.9877"


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_labels_hide_neither_points_nor_one_another(seed, count):
    rng = np.random.default_rng(seed)
    at = np.column_stack([rng.uniform(0, 640, count), rng.uniform(0, 400, count)])
    middle = at + label_offsets(at, np.zeros(2), np.array([640.0, 400.0]))
    assert (middle > 0).all() and (middle < [640, 400]).all()
    for k in range(count):
        others = np.abs(middle[k] - np.delete(middle, k, axis=0))
        assert not (others < [18, 14]).all(axis=1).any()
