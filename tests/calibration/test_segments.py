"""From detections to upright segments: which ends are used, and who is left out."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import draw_scene, solve_points

from scene4d.calibration import CalibrateOptions, person_segments
from scene4d.calibration._segments import MIN_LENGTH_PX
from scene4d.calibration.watching import Seen, solved
from scene4d.core.body import COCO17, HALPE26, MIN_KEYPOINT_SCORE
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections

SIZE = (640, 480)
FEET = [i for i, name in enumerate(HALPE26) if name.endswith(("toe", "heel"))]


def skeletons(foot_uv, head_uv, *, size=SIZE, score=0.9) -> Detections:
    """People whose 26 keypoints lie on a line from foot to head, feet spread about the midpoint."""
    n = len(foot_uv)
    foot, head = np.asarray(foot_uv, float), np.asarray(head_uv, float)
    share = np.linspace(0.95, 0.4, 26)
    uv = foot[:, None] + share[None, :, None] * (head - foot)[:, None]
    uv[:, HALPE26.index("head_top")] = head
    spread = np.array([[-9, 2], [9, -2], [-7, 3], [7, -3], [-5, 1], [5, -1]], float)
    uv[:, FEET] = foot[:, None] + spread
    box = np.column_stack([foot[:, 0] - 20, head[:, 1], foot[:, 0] + 20, foot[:, 1]])
    return Detections.from_boxes(
        size,
        np.arange(n),
        box,
        time_s=0.1 * np.arange(n),
        track=np.arange(n) + 5,
        score=np.linspace(0.5, 0.9, n),
        keypoint_uv=uv,
        keypoint_score=np.full((n, 26), score),
        keypoint_names=HALPE26,
    )


FOOT = np.array([[100.0, 300.0], [320.0, 400.0], [500.0, 450.0]])
HEAD = np.array([[104.0, 180.0], [320.0, 240.0], [480.0, 250.0]])


def test_keypoints_give_the_midpoint_of_the_feet_and_the_top_of_the_head():
    people = skeletons(FOOT, HEAD)
    found = person_segments(people)
    np.testing.assert_allclose(found.foot_uv, FOOT)
    np.testing.assert_allclose(found.head_uv, HEAD)
    assert not found.from_box.any()
    for name in ("frame", "time_s", "track", "score", "box_xyxy"):
        np.testing.assert_array_equal(getattr(found, name), getattr(people, name))


def test_each_foot_counts_once():
    """The midpoint is that of two feet, wherever each foot's three points lie."""
    people = skeletons(FOOT, HEAD)
    left = [HALPE26.index(f"left_{part}") for part in ("big_toe", "small_toe", "heel")]
    right = [HALPE26.index(f"right_{part}") for part in ("big_toe", "small_toe", "heel")]
    uv = people.keypoint_uv.copy()
    uv[:, left] = FOOT[:, None] + [12.0, 6.0]
    uv[:, right] = FOOT[:, None] - [12.0, 6.0]
    found = person_segments(replace(people, keypoint_uv=uv))
    np.testing.assert_allclose(found.foot_uv, FOOT)


@pytest.mark.parametrize("name", ["head_top", "left_heel", "right_big_toe", "left_hip"])
def test_who_is_not_seen_whole_is_left_out(name):
    people = skeletons(FOOT, HEAD)
    score = people.keypoint_score.copy()
    score[1, HALPE26.index(name)] = MIN_KEYPOINT_SCORE - 0.05
    found = person_segments(replace(people, keypoint_score=score))
    np.testing.assert_array_equal(found.track, people.track[[0, 2]])


def test_what_the_segment_does_not_need_may_be_hidden():
    people = skeletons(FOOT, HEAD)
    score = people.keypoint_score.copy()
    score[:, [HALPE26.index(f"{side}_wrist") for side in ("left", "right")]] = 0.0
    assert len(person_segments(replace(people, keypoint_score=score))) == 3


def test_keypoints_outside_the_image_were_not_seen():
    foot = np.array([[100.0, 300.0], [320.0, 480.5], [500.0, 300.0], [-1.0, 300.0]])
    head = np.array([[104.0, 180.0], [320.0, 240.0], [500.0, -1.0], [2.0, 180.0]])
    found = person_segments(skeletons(foot, head))
    np.testing.assert_array_equal(found.frame, [0])


def test_tiny_and_upside_down_people_are_left_out():
    head = HEAD.copy()
    head[0] = FOOT[0] - [0, MIN_LENGTH_PX - 1]
    head[1] = FOOT[1] + [0, 80.0]
    np.testing.assert_array_equal(person_segments(skeletons(FOOT, head)).frame, [2])


def test_boxes_give_top_and_bottom_centre_and_say_so():
    box = np.array([[100.0, 50.0, 150.0, 200.0], [300.0, 60.0, 340.0, 170.0]])
    found = person_segments(Detections.from_boxes(SIZE, np.arange(2), box))
    np.testing.assert_allclose(found.foot_uv, [[125, 200], [320, 170]])
    np.testing.assert_allclose(found.head_uv, [[125, 50], [320, 60]])
    assert found.from_box.all()


@pytest.mark.parametrize(
    "box",
    [
        [0.0, 100.0, 40.0, 220.0],
        [100.0, 0.0, 150.0, 200.0],
        [600.0, 100.0, 639.0, 220.0],
        [100.0, 300.0, 150.0, 479.0],
        [-5.0, 100.0, 40.0, 220.0],
        [100.0, 300.0, 150.0, 490.0],
    ],
)
def test_a_box_cut_by_the_border_hides_an_end(box):
    whole = [300.0, 60.0, 340.0, 170.0]
    found = person_segments(Detections.from_boxes(SIZE, np.arange(2), np.array([box, whole])))
    np.testing.assert_array_equal(found.frame, [1])


def test_a_box_near_the_border_is_whole():
    box = np.array([[4.0, 4.0, 60.0, 200.0], [590.0, 300.0, 634.0, 474.0]])
    assert len(person_segments(Detections.from_boxes(SIZE, np.arange(2), box))) == 2


def test_without_the_needed_keypoints_boxes_are_read():
    """COCO skeletons have neither head top nor toes: those people are boxes."""
    people = skeletons(FOOT, HEAD)
    coco = replace(
        people,
        keypoint_uv=people.keypoint_uv[:, :17],
        keypoint_score=people.keypoint_score[:, :17],
        keypoint_names=COCO17,
    )
    found = person_segments(coco)
    assert found.from_box.all()
    np.testing.assert_allclose(found.foot_uv[:, 1], people.box_xyxy[:, 3])
    one_missing = tuple("chin" if name == "left_heel" else name for name in HALPE26)
    assert person_segments(replace(people, keypoint_names=one_missing)).from_box.all()


def test_the_order_of_keypoint_names_is_the_tables_own():
    people = skeletons(FOOT, HEAD)
    order = np.random.default_rng(0).permutation(26)
    shuffled = replace(
        people,
        keypoint_uv=people.keypoint_uv[:, order],
        keypoint_score=people.keypoint_score[:, order],
        keypoint_names=tuple(HALPE26[i] for i in order),
    )
    np.testing.assert_allclose(person_segments(shuffled).foot_uv, FOOT)


def test_only_persons_stand_upright():
    people = skeletons(FOOT, HEAD)
    mixed = replace(people, class_name=np.array(["person", "bicycle", "person"]))
    np.testing.assert_array_equal(person_segments(mixed).frame, [0, 2])


def test_nobody_gives_no_segments():
    assert len(person_segments(Detections.from_boxes(SIZE, np.arange(0), np.empty((0, 4))))) == 0
    assert len(person_segments(skeletons(np.empty((0, 2)), np.empty((0, 2))))) == 0


def test_skeletons_calibrate_a_camera():
    scene = draw_scene(5, 60)
    people = skeletons(scene.people.foot_uv, scene.people.head_uv, size=scene.camera.image_size)
    found = solve_points(
        person_segments(people), image_size=scene.camera.image_size, estimate_distortion=False
    )
    assert found
    assert found.camera.focal_px == pytest.approx(scene.camera.focal_px, rel=0.1)
    assert found.camera.height_m == pytest.approx(scene.camera.height_m, rel=0.1)


def test_the_papers_method_takes_boxes_that_stand_on_the_ground():
    """As published: the keypoints of the same people are another answer."""
    scene = draw_scene(3, 40, height_sigma=0.0, noise=0.0, noise_px=0.0)
    camera, xy = scene.camera, scene.people.xy_m
    on_ground, top = (
        camera.project(np.column_stack([xy, np.full(len(xy), z)]))[0] for z in (0.0, 1.7)
    )
    upright = np.abs(on_ground[:, 0] - top[:, 0]) < 5
    people = skeletons(scene.people.foot_uv[upright], top[upright], size=camera.image_size)
    foot, head = on_ground[upright], top[upright]
    box = np.column_stack([foot[:, 0] - 20, head[:, 1], foot[:, 0] + 20, foot[:, 1]])
    told = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    options = CalibrateOptions(method="paper", orientation=told)
    found = solved(Seen(replace(people, box_xyxy=box), 40), options)
    assert found and found.segments.from_box.all()
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=0.005)
    assert not any("keypoints" in text for text in found.warnings)
    joint = solved(Seen(people, 40), CalibrateOptions(orientation=told))
    assert not joint.segments.from_box.any()
