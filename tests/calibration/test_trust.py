"""Errors that the model does not know of are in what is stated: per track, by another minimum."""

from dataclasses import replace

import numpy as np
from scenes import Scene, draw_scene, errors_of, sigmas_of, solve_points

from scene4d.calibration import CalibrateOptions, _uncertainty, solve_segments
from scene4d.calibration._problem import Noise, State
from scene4d.core.people import Segments

SEEDS = range(16)
LEAN_RAD = 0.05


def swaying(scene: Scene, rng: np.random.Generator) -> Segments:
    """People who each lean their own way wherever they are: every track errs as a whole."""
    people = scene.people
    span = people.head_uv - people.foot_uv
    turn = rng.normal(0, LEAN_RAD, people.track.max() + 1)[people.track]
    head = people.foot_uv + np.column_stack(
        [
            np.cos(turn) * span[:, 0] - np.sin(turn) * span[:, 1],
            np.sin(turn) * span[:, 0] + np.cos(turn) * span[:, 1],
        ]
    )
    found = Segments.from_points(people.foot_uv, head, track=people.track)
    return replace(found, frame=np.arange(len(found)))


def rms_z(seeds: range = SEEDS) -> np.ndarray:
    """Of focal length, tilt, roll and height over crowds of twelve who sway."""
    z = []
    for seed in seeds:
        scene = draw_scene(seed, 300, tracks=12, tilt_deg=25.0, height_m=6.0, fov_deg=60.0)
        people = swaying(scene, np.random.default_rng(100 + seed))
        found = solve_points(people, scene.camera.image_size, estimate_distortion=False)
        z.append(errors_of(scene, found) / sigmas_of(found))
    return np.sqrt((np.array(z) ** 2).mean(axis=0))


def test_tracks_that_err_as_a_whole_are_in_the_stated_uncertainty():
    stated = rms_z()
    assert (stated < 1.65).all() and stated[2] > 0.6, stated


def test_without_the_jackknife_roll_would_be_stated_far_too_surely(monkeypatch):
    monkeypatch.setattr(_uncertainty, "_beyond_the_model", lambda *_: np.zeros((7, 7)))
    assert rms_z(SEEDS[:8])[2] > 2


def test_the_jackknife_leaves_independent_errors_nearly_as_they_are(monkeypatch):
    """Its own noise may widen a little; it never narrows."""
    scene = draw_scene(3, 400, tracks=40, tilt_deg=25.0, height_m=6.0, fov_deg=60.0)
    people = Segments.from_points(
        scene.people.foot_uv, scene.people.head_uv, track=scene.people.track
    )
    people = replace(people, frame=np.arange(len(people)))
    wide = sigmas_of(solve_points(people, scene.camera.image_size))
    monkeypatch.setattr(_uncertainty, "_beyond_the_model", lambda *_: np.zeros((7, 7)))
    plain = sigmas_of(solve_points(people, scene.camera.image_size))
    assert (wide >= plain).all() and (wide < 1.4 * plain).all()


def test_a_rival_as_likely_as_the_answer_adds_its_distance():
    here, there = np.zeros(7), np.array([0.4, -0.1, 0.0, 0.2, 0.0, 0.0, 0.0])
    state = State(here, np.empty(0), Noise(), rivals=((0.0, there),))
    found = _uncertainty._of_rivals(state)
    # Two equal modes at a distance d from each other: a quarter of d² about the middle, a half
    # about one of them.
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.abs(there) / np.sqrt(2))
    assert not _uncertainty._of_rivals(replace(state, rivals=())).any()


def z_beside_seated_people(seed: int) -> np.ndarray:
    """Errors in standard deviations where a third of all tracks are boxes of seated people."""
    scene = draw_scene(seed, 260, tracks=20, tilt_deg=20.0, height_m=4.0, fov_deg=55.0)
    people, rng = scene.people, np.random.default_rng(seed)
    foot, head, track = people.foot_uv, people.head_uv, people.track.copy()
    low = rng.choice(len(foot), 12, replace=False)  # twelve more, each seated in one place
    foot, head = np.vstack([foot, foot[low]]), np.vstack([head, (0.35 * foot + 0.65 * head)[low]])
    track = np.append(track, 100 + np.arange(12))
    boxes = Segments.from_points(foot, head, track=track, from_box=True)
    boxes = replace(boxes, frame=np.arange(len(boxes)))
    options = CalibrateOptions(lens=scene.camera.lens, orientation="people", lines=False)
    found = solve_segments(boxes, scene.camera.image_size, options)
    return errors_of(scene, found)[1:] / sigmas_of(found)[1:]


def test_boxes_that_never_move_may_be_seated_and_mislead_little():
    z = np.array([z_beside_seated_people(seed) for seed in range(5)])
    assert (np.sqrt((z**2).mean(axis=0)) < 2.5).all(), z
