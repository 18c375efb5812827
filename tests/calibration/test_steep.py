"""Cameras that look steeply down, and cameras two metres from a crowd: known noise in, and stated
uncertainties that hold, not too small and not too large.
"""

import numpy as np
import pytest
from scenes import Scene, errors_of, sigmas_of, solve_points

from scene4d.calibration import person_segments
from scene4d.core.body import HALPE26
from scene4d.core.people import Detections, Segments
from strategies import PeopleScene, build_camera, build_lens, people_scene


def drawn(seed: int, tilt_deg: tuple, height_m: tuple, fov_deg: tuple, noise_px: float) -> Scene:
    """150 sightings of 25 people before a camera within these ranges."""
    rng = np.random.default_rng(seed)
    for _ in range(100):
        lens = build_lens((1280, 960), rng.uniform(*fov_deg))
        camera = build_camera(
            lens, rng.uniform(*tilt_deg), rng.normal(0, 4), rng.uniform(*height_m)
        )
        try:
            return Scene(camera, people_scene(camera, 150, rng, tracks=25, noise_px=noise_px))
        except ValueError:  # no room for whole people
            continue
    raise AssertionError("no such view of whole people")


def segments_of(people: PeopleScene) -> Segments:
    return Segments.from_points(people.foot_uv, people.head_uv, track=people.track)


@pytest.mark.parametrize(
    ("tilt_deg", "height_m", "fov_deg"),
    [
        pytest.param((50, 65), (3, 8), (50, 95), id="steep"),
        pytest.param((65, 80), (3, 8), (60, 100), id="very steep"),
        pytest.param((5, 40), (1.9, 2.6), (75, 110), id="two metres from the crowd"),
    ],
)
def test_stated_uncertainty_holds(tilt_deg, height_m, fov_deg):
    scores = []
    for seed in range(10):
        scene = drawn(seed, tilt_deg, height_m, fov_deg, noise_px=1.5)
        found = solve_points(segments_of(scene.people), scene.camera.image_size)
        scores.append(errors_of(scene, found) / sigmas_of(found))
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert (rms > 0.4).all() and (rms < 1.5).all(), rms


def test_straight_down_the_focal_length_is_said_to_be_open_or_is_right():
    """At 85° people are seen from above, and their sizes alone tell how high the camera is."""
    for seed in range(4):
        scene = drawn(seed, (80, 88), (3, 8), (60, 100), noise_px=1.0)
        found = solve_points(segments_of(scene.people), scene.camera.image_size)
        if not found:
            assert found.reason is not None and "focal length is not determined" in found.reason
            continue
        assert np.abs(errors_of(scene, found) / sigmas_of(found)).max() < 4


def detections_of(people: PeopleScene, size: tuple[int, int]) -> Detections:
    """Keypoints on the line from foot to head, boxes about both."""
    n = len(people)
    share = np.linspace(0.95, 0.4, 26)
    uv = people.foot_uv[:, None] + share[:, None] * (people.head_uv - people.foot_uv)[:, None]
    uv[:, HALPE26.index("head_top")] = people.head_uv
    uv[:, [i for i, name in enumerate(HALPE26) if name.endswith(("toe", "heel"))]] = people.foot_uv[
        :, None
    ]
    ends = np.stack([people.foot_uv, people.head_uv])
    box = np.column_stack([ends.min(axis=0) - 20, ends.max(axis=0) + 20])
    return Detections.from_boxes(
        size, np.arange(n), box, track=people.track, keypoint_uv=uv,
        keypoint_score=np.full((n, 26), 0.9), keypoint_names=HALPE26,
    )  # fmt: skip


def test_people_beyond_the_point_below_the_camera_count():
    """Their heads are lower in the picture than their feet."""
    scene = drawn(0, (72, 80), (4, 6), (75, 90), noise_px=0.5)
    people, size = scene.people, scene.camera.image_size
    beyond = people.head_uv[:, 1] > people.foot_uv[:, 1]
    long = np.hypot(*(people.head_uv - people.foot_uv).T) > 30
    assert 10 < beyond.sum() < 100
    kept = person_segments(detections_of(people, size))
    rows = np.isclose(kept.foot_uv[:, None], people.foot_uv).all(axis=2).any(axis=0)
    assert rows[long].mean() > 0.97


def test_mirror_images_below_an_ordinary_camera_do_not():
    scene = drawn(3, (12, 25), (4, 6), (50, 60), noise_px=0.5)
    people, size = scene.people, scene.camera.image_size
    mirrored = np.arange(len(people)) % 4 == 0
    seen = detections_of(people, size)
    uv = seen.keypoint_uv.copy()
    uv[mirrored] = 2 * people.foot_uv[mirrored, None] - uv[mirrored]
    uv = np.clip(uv, 0, np.array(size) - 1)
    kept = person_segments(
        Detections.from_boxes(
            size,
            seen.frame,
            seen.box_xyxy,
            track=seen.track,
            keypoint_uv=uv,
            keypoint_score=seen.keypoint_score,
            keypoint_names=HALPE26,
        )
    )
    assert (kept.head_uv[:, 1] < kept.foot_uv[:, 1]).all()
    assert len(kept) == (~mirrored).sum()
