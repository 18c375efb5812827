"""Where people stand, against people whose places are known; and against PETS."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from tests import strategies

from bodies import Crowd, cameras, crowd, with_boxes, with_keypoints
from scene4d.core.body import COCO17, HALPE26
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._people import explain_people, locate_people
from scene4d.tracking._people_points import DRAWN_BOX_SHARE
from scene4d.tracking._rays import Rays

CHI2_95 = 5.991
FEET = slice(20, 26)


def hidden(detections: Detections, points: slice | list[int]) -> Detections:
    """The same people with some keypoints unseen."""
    score = detections.keypoint_score.copy()
    score[:, points] = 0.1
    return replace(detections, keypoint_score=score)


def squared_distance(located: Located, people: Crowd) -> np.ndarray:
    off = located.xy_m - people.xy_m
    return np.einsum("ni,nij,nj->n", off, np.linalg.inv(located.covariance_m2), off)


def rms(located: Located, people: Crowd) -> float:
    return float(np.sqrt(((located.xy_m - people.xy_m) ** 2).sum(axis=1).mean()))


@settings(max_examples=60)
@given(
    strategies.views() | strategies.views(strategies.cameras(strategies.fisheye_lenses())),
    st.floats(0.0, 1.8),
)
def test_rays_and_their_derivatives_agree_with_the_camera(view, height):
    camera, _, flat = view
    uv, valid = camera.distort(flat)
    assume(valid.all())
    assume(abs(camera.height_m - height) > 0.1)
    rays = Rays.through(camera, uv)
    level = rays.meet(height)
    np.testing.assert_allclose(np.linalg.norm(rays.row_normal, axis=1), 1.0)
    expected, valid = camera.locate(flat, height, undistorted=True)
    np.testing.assert_array_equal(np.isfinite(level.xy_m).all(axis=1), valid)
    np.testing.assert_allclose(level.xy_m, expected, rtol=1e-6, atol=1e-6)
    far = np.linalg.norm(expected - camera.centre_m[:2], axis=1)
    size = np.abs(level.by_uv).max(axis=(1, 2))
    near = valid & (far < 20 * abs(camera.height_m - height)) & (size < 1.0)
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = 0.01
        there, _ = camera.locate(uv + step, height)
        here, _ = camera.locate(uv - step, height)
        seen = near & np.isfinite(there + here).all(axis=1)
        slope = (there - here) / 0.02
        assert (np.abs(slope - level.by_uv[:, :, axis])[seen] < 0.02 * size[seen, None]).all()
    higher, _ = camera.locate(flat, height + 1e-4, undistorted=True)
    seen = valid & np.isfinite(higher).all(axis=1)
    np.testing.assert_allclose(
        ((higher - expected) / 1e-4)[seen], level.by_height[seen], rtol=1e-3, atol=1e-3
    )


@settings(max_examples=25)
@given(strategies.cameras_over_people(strategies.lenses()), st.integers(0, 99))
def test_without_noise_people_stand_where_they_stand(camera, seed):
    try:
        people = crowd(camera, 12, np.random.default_rng(seed))
    except ValueError:  # no room for people in this view
        assume(False)
    found = explain_people(with_keypoints(people), camera, height_m=people.height_m)
    assert (found.lower != "").any()
    feet = found.lower == "both feet"
    # Toes stand before the heels: the mean of their pixels is not quite the pixel of their mean.
    near = 0.01 + 0.002 * np.linalg.norm(people.xy_m - camera.centre_m[:2], axis=1)
    assert (np.linalg.norm(found.located.xy_m - people.xy_m, axis=1)[feet] < near[feet]).all()
    legless = hidden(with_keypoints(people), FEET)
    alone = explain_people(legless, camera, height_m=people.height_m)
    assert (alone.lower == "").all()
    known = alone.located.known
    np.testing.assert_allclose(alone.located.xy_m[known], people.xy_m[known], atol=1e-5)


@pytest.mark.parametrize("roll_deg", [0.0, 12.0])
@pytest.mark.parametrize("tilt_deg", [15.0, 40.0])
def test_a_box_around_a_solid_body_is_placed_at_its_axis(tilt_deg, roll_deg):
    lens = strategies.build_lens((1280, 720), 60.0, radial=(-0.05, 0.0, 0.0))
    camera = strategies.build_camera(lens, tilt_deg, roll_deg, 8.0, 30.0)
    people = crowd(camera, 200, np.random.default_rng(1))
    found = explain_people(with_boxes(people), camera, height_m=people.height_m)
    off = np.linalg.norm(found.located.xy_m - people.xy_m, axis=1)
    assert np.quantile(off, 0.95) < 0.03  # a quarter of a metre where the body has no radius


WAYS = {
    "keypoints": lambda people, rng: with_keypoints(people, rng),
    "hidden feet": lambda people, rng: hidden(with_keypoints(people, rng), FEET),
    "hidden heads": lambda people, rng: hidden(with_keypoints(people, rng), [17]),
    "boxes": with_boxes,
}


@pytest.mark.parametrize("way", WAYS)
def test_the_ellipses_hold_the_truth_as_often_as_they_say_and_nothing_leans(way):
    rng = np.random.default_rng(5)
    inside, pulls, sizes = [], [], []
    for camera in cameras(12):
        people = crowd(camera, 250, rng)
        located = locate_people(WAYS[way](people, rng), camera)
        known = located.known
        assert known.mean() > 0.95
        chosen = Crowd(camera, people.xy_m[known], people.height_m[known], people.yaw_rad[known])
        squared = squared_distance(located.select(known), chosen)
        inside.append((squared < CHI2_95).mean())
        away = chosen.xy_m - camera.centre_m[:2]
        away /= np.linalg.norm(away, axis=1)[:, None]
        sigma = np.sqrt(np.einsum("ni,nij,nj->n", away, located.covariance_m2[known], away))
        pull = ((located.xy_m[known] - chosen.xy_m) * away).sum(axis=1) / sigma
        pulls.append(pull)
        sizes.append(squared)
    assert min(inside) > 0.85
    assert max(inside) < 0.99
    assert 0.92 < np.mean(inside) < 0.98
    assert abs(np.concatenate(pulls).mean()) < 0.25
    assert 0.4 < np.mean(np.concatenate(sizes) < 1.386) < 0.6  # half in the 50 % ellipse


def test_both_ends_together_are_no_worse_than_the_better_one():
    rng = np.random.default_rng(6)
    for camera in cameras(8):
        people = crowd(camera, 300, rng)
        seen = with_keypoints(people, rng)
        both = rms(locate_people(seen, camera), people)
        feet = rms(locate_people(hidden(seen, [17]), camera), people)
        head = rms(locate_people(hidden(seen, FEET), camera), people)
        assert both < 1.02 * min(feet, head)


def test_a_height_of_ones_own_is_worth_having():
    rng = np.random.default_rng(7)
    camera = cameras(1)[0]
    people = crowd(camera, 300, rng)
    seen = hidden(with_keypoints(people, rng), FEET)
    sigma = np.full(300, 0.02)
    own = locate_people(seen, camera, height_m=people.height_m, height_sigma_m=sigma)
    mean = locate_people(seen, camera)
    assert rms(own, people) < 0.7 * rms(mean, people)
    assert 0.85 < (squared_distance(own, people) < CHI2_95).mean() < 0.99


def one_of(**changes) -> tuple[Crowd, Detections]:
    """One person of 1.70 m in the middle of a plain view."""
    camera = strategies.build_camera(tilt_deg=20.0, height_m=6.0)
    people = Crowd(camera, np.array([[1.0, 16.0]]), np.array([1.70]), np.array([0.5]))
    return people, replace(with_keypoints(people), **changes)


def test_who_sits_is_placed_by_the_feet():
    people, _ = one_of()
    low = replace(people, height_m=np.array([1.0]))
    found = explain_people(with_keypoints(low), people.camera)
    assert (found.lower[0], found.upper[0]) == ("both feet", "")
    feet = locate_people(hidden(with_keypoints(low), [17]), people.camera)
    assert feet.known.all()
    np.testing.assert_allclose(found.located.covariance_m2, feet.covariance_m2, rtol=0.5)
    assert np.linalg.norm(found.located.xy_m - people.xy_m) < 0.05


@pytest.mark.parametrize("seen", ["upper half", "stooping"])
def test_either_end_of_a_short_box_may_be_the_right_one(seen):
    """Legs behind something, or a head bent down: the box does not tell which."""
    people, _ = one_of()
    box = with_boxes(people)
    x1, y1, x2, y2 = box.box_xyxy[0]
    short = [x1, y1, x2, (y1 + y2) / 2] if seen == "upper half" else [x1, (y1 + y2) / 2, x2, y2]
    half = replace(box, box_xyxy=np.array([short]))
    found = explain_people(half, people.camera, box_share=DRAWN_BOX_SHARE)
    assert (found.lower[0], found.upper[0]) == ("box bottom", "box top")
    error = (found.located.xy_m - people.xy_m)[0]
    squared = error @ np.linalg.solve(found.located.covariance_m2[0], error)
    assert np.linalg.norm(error) > 0.4
    assert 0.05 < squared < 4.0
    whole = locate_people(box, people.camera, box_share=DRAWN_BOX_SHARE)
    away, aside = np.diag(found.located.covariance_m2[0]) / np.diag(whole.covariance_m2[0])
    assert min(away, aside) < 3, "hardly wider across the line of sight"
    assert max(away, aside) > 10


def test_up_to_a_chance_difference_nothing_is_added():
    people, _ = one_of()
    for metres, wider in ((1.70, False), (1.62, False), (1.30, True)):
        low = replace(people, height_m=np.array([metres]))
        boxes = with_boxes(low)
        found = locate_people(boxes, people.camera, box_share=DRAWN_BOX_SHARE)
        own = locate_people(
            boxes, people.camera, box_share=DRAWN_BOX_SHARE, height_m=np.array([metres])
        )
        ratio = np.trace(found.covariance_m2[0]) / np.trace(own.covariance_m2[0])
        assert (ratio > 1.5) == wider


def test_where_the_head_is_seen_and_no_foot_the_box_ends_at_no_foot():
    people, _ = one_of()
    x1, y1, x2, y2 = with_boxes(people).box_xyxy[0]
    people, seen = one_of(box_xyxy=np.array([[x1, y1, x2, (y1 + y2) / 2]]))
    found = explain_people(hidden(seen, FEET), people.camera)
    assert (found.lower[0], found.upper[0]) == ("", "head")


def test_one_foot_and_ends_beyond_the_border():
    people, seen = one_of()
    both = locate_people(seen, people.camera)
    found = explain_people(hidden(seen, [21, 23, 25]), people.camera)
    assert found.lower[0] == "one foot"
    assert np.trace(found.located.covariance_m2[0]) > 1.5 * np.trace(both.covariance_m2[0])
    height = people.camera.image_size[1]
    x1, y1, x2, y2 = with_boxes(people).box_xyxy[0]
    box = with_boxes(people)
    for edge, left in ((height - 1.0, ("", "box top")), (height - 4.0, ("box bottom", ""))):
        cut = replace(box, box_xyxy=np.array([[x1, y1 if not left[0] else 0.0, x2, edge]]))
        found = explain_people(cut, people.camera)
        assert (found.lower[0], found.upper[0]) == left
    aside = replace(box, box_xyxy=np.array([[0.0, y1, x2 - x1, y2]]))
    inside = replace(box, box_xyxy=np.array([[5.0, y1, x2 - x1 + 5.0, y2]]))
    across = [locate_people(b, people.camera).covariance_m2[0, 0, 0] for b in (aside, inside)]
    assert across[0] > 1.3 * across[1]


def test_above_the_horizon_nobody_stands():
    camera = strategies.build_camera(tilt_deg=2.0, height_m=6.0)
    people = Crowd(camera, np.array([[1.0, 30.0]]), np.array([1.70]), np.array([0.5]))
    seen = with_keypoints(people)
    horizon = camera.image_size[1] / 2 - camera.focal_px * np.tan(np.radians(2.0))
    up = np.array([0.0, seen.box_xyxy[0, 3] - horizon + 5.0])
    sky = replace(seen, keypoint_uv=seen.keypoint_uv - up, box_xyxy=seen.box_xyxy - np.tile(up, 2))
    assert sky.keypoint_uv[:, 17].min() > 0
    for detections in (sky, sky.without_keypoints()):
        found = explain_people(detections, people.camera)
        assert not found.located.known.any()
        assert (found.lower[0], found.upper[0]) == ("", "")
        for field in fields(Located)[:4]:
            assert np.isnan(getattr(found.located, field.name)).all()


def test_a_head_at_the_camera_s_own_height_says_nothing():
    camera = strategies.build_camera(tilt_deg=5.0, height_m=1.8)
    people = Crowd(camera, np.array([[0.0, 8.0]]), np.array([1.7]), np.array([0.0]))
    seen = with_keypoints(people)
    assert not locate_people(hidden(seen, FEET), camera).known.any()
    found = explain_people(seen, camera)
    assert (found.lower[0], found.upper[0]) == ("both feet", "")


def test_every_row_is_placed_as_if_it_were_alone():
    rng = np.random.default_rng(9)
    camera = cameras(2)[1]
    people = crowd(camera, 24, rng)
    seen = with_keypoints(people, rng)
    score = seen.keypoint_score.copy()
    score[rng.random(score.shape) < 0.1] = 0.0
    score[3] = 0.0
    uv = seen.keypoint_uv.copy()
    uv[5] = np.nan
    seen = replace(seen, keypoint_score=score, keypoint_uv=uv)
    height = people.height_m
    together = locate_people(seen, camera, height_m=height)
    alone = [
        locate_people(seen.select(np.array([i])), camera, height_m=height[i : i + 1])
        for i in range(24)
    ]
    for field in fields(Located):
        parts = np.concatenate([getattr(one, field.name) for one in alone])
        np.testing.assert_allclose(getattr(together, field.name), parts, rtol=1e-7, atol=1e-9)
    assert together.known[[3, 5]].all()  # the boxes are left


def test_headings_point_where_bodies_face():
    people, seen = one_of()
    for yaw in np.radians([-170, -90, -20, 0, 45, 130]):
        turned = replace(people, yaw_rad=np.array([yaw]))
        located = locate_people(with_keypoints(turned), people.camera)
        assert abs(np.angle(np.exp(1j * (located.heading_rad[0] - yaw)))) < 0.05
        assert not located.heading_is_axis[0]
    assert np.isnan(locate_people(hidden(seen, slice(0, 26)), people.camera).heading_rad).all()
    assert np.isnan(locate_people(seen.without_keypoints(), people.camera).heading_rad).all()
    trunk = locate_people(hidden(seen, FEET), people.camera)
    assert abs(trunk.heading_rad[0] - 0.5) < 0.2  # a mean of directions, seen unequally well
    assert trunk.heading_sigma_rad[0] > locate_people(seen, people.camera).heading_sigma_rad[0]


def test_headings_err_as_much_as_they_say():
    rng = np.random.default_rng(10)
    off, sigma = [], []
    for camera in cameras(6):
        people = crowd(camera, 200, rng)
        taken = people.yaw_rad + np.where(rng.random(200) < 0.04, np.pi, 0.0)  # left for right
        seen = with_keypoints(replace(people, yaw_rad=taken), rng, twist_m=0.08)
        uv = seen.keypoint_uv.copy()
        noise = np.hypot(1.0, 0.03 * people.length_px)[:, None, None] / np.sqrt(2)
        uv[:, [5, 6]] += noise * rng.normal(size=(200, 2, 2))
        for toes, heel in (([20, 22], 24), ([21, 23], 25)):
            uv[:, toes] += noise * rng.normal(size=(200, 1, 2))
            uv[:, [heel]] += noise * rng.normal(size=(200, 1, 2))
        located = locate_people(replace(seen, keypoint_uv=uv), camera)
        off.append(np.angle(np.exp(1j * (located.heading_rad - people.yaw_rad))))
        sigma.append(located.heading_sigma_rad)
    off, sigma = np.concatenate(off), np.concatenate(sigma)
    known = np.isfinite(off)
    assert known.mean() > 0.9
    assert 0.92 < (np.abs(off) < 2 * sigma)[known].mean() < 0.98
    assert abs(np.angle(np.exp(1j * off[known]).mean())) < 0.05


@pytest.mark.parametrize("keypoints", [FEET, [5, 6]], ids=["shoulders", "feet"])
def test_a_turned_world_turns_everything_and_changes_nothing(keypoints):
    rng = np.random.default_rng(12)
    lens = strategies.build_lens(radial=(-0.05, 0.0, 0.0))
    plain = strategies.build_camera(lens, 18.0, 4.0, 6.0)
    people = crowd(plain, 30, rng)
    seen = hidden(with_keypoints(people, rng), keypoints)
    here = locate_people(seen, plain)
    c, s = np.cos(np.radians(40.0)), np.sin(np.radians(40.0))
    turn = np.array([[c, -s], [s, c]])
    turned = replace(plain, R=plain.R @ np.block([[turn.T, np.zeros((2, 1))], [0, 0, 1]]))
    there = locate_people(seen, turned)
    np.testing.assert_allclose(there.xy_m, here.xy_m @ turn.T, atol=1e-6)
    np.testing.assert_allclose(
        there.covariance_m2, turn @ here.covariance_m2 @ turn.T, rtol=1e-6, atol=1e-9
    )
    off = np.angle(np.exp(1j * (there.heading_rad - here.heading_rad)))
    told = np.isfinite(here.heading_rad)
    assert told.mean() > 0.5
    np.testing.assert_allclose(off[told], np.radians(40.0), atol=0.01)
    np.testing.assert_allclose(there.heading_sigma_rad, here.heading_sigma_rad, atol=0.01)


def test_skeletons_without_feet_fall_back_on_the_box():
    people, seen = one_of()
    coco = replace(
        seen,
        keypoint_uv=seen.keypoint_uv[:, :17],
        keypoint_score=seen.keypoint_score[:, :17],
        keypoint_names=COCO17,
    )
    found = explain_people(coco, people.camera)
    assert (found.lower[0], found.upper[0]) == ("box bottom", "box top")
    assert seen.keypoint_names == HALPE26


def test_nobody_and_another_image_size():
    people, seen = one_of()
    none = seen.select(np.zeros(1, bool))
    assert len(locate_people(none, people.camera)) == 0
    other = replace(seen, image_size=(640, 360))
    with pytest.raises(InputError, match=r"640x360.*1280x720"):
        locate_people(other, people.camera)


@pytest.mark.weights
def test_people_of_pets_stand_where_their_hand_drawn_boxes_do(shared_data: Path):
    from benchmarks.people_positions import drawn_truth, matched

    from scene4d.formats.annotations import read_annotations
    from scene4d.formats.cameras import read_camera
    from scene4d.perception.people import PeopleDetector, detect_people
    from scene4d.video.reader import open_source

    folder = shared_data / "pets2009"
    camera = read_camera(folder / "View_001.xml")
    boxes = read_annotations(folder / "PETS2009-S2L1.xml", image_size=camera.image_size, fps=10.0)
    with open_source(folder / "vtest.avi") as source:
        found = detect_people(source.frames(range(20, 780, 50)), PeopleDetector.default())
    found, truth = matched(found, drawn_truth(boxes, camera))
    assert len(found) > 70
    for detections, at_most in ((found, 0.25), (found.without_keypoints(), 0.3)):
        located = locate_people(detections, camera)
        assert located.known.all()
        off = located.xy_m - truth.xy
        squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(located.covariance_m2), off)
        assert 0.85 < (squared < CHI2_95).mean() <= 0.99
        assert np.median(np.linalg.norm(off, axis=1)) < at_most
