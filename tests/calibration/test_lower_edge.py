"""Boxes whose edges stray: the lower one is where a person stands."""

from dataclasses import replace

import numpy as np
from scenes import Scene, draw_scene, errors_of, sigmas_of
from test_drift import PEOPLE, boxes

from scene4d.calibration import CalibrateOptions, solve_segments
from type_checks import unchecked


def shallow(seed: int) -> np.ndarray:
    """Errors of tilt, roll and log height in sigmas, and the log height's error, from people at
    much the same distance, the edges of whose boxes stray by 4 % of their length.
    """
    scene = draw_scene(seed, 4000, tilt_deg=15.0, roll_deg=0.0, height_m=9.0, fov_deg=30.0)
    camera, rng = scene.camera, np.random.default_rng(seed)
    row = scene.people.foot_uv[:, 1]
    length = np.median(row - scene.people.head_uv[:, 1])
    rows = np.flatnonzero(np.abs(row - np.median(row)) < 0.45 * length)[:PEOPLE]
    people = replace(scene.people, foot_uv=scene.people.foot_uv[rows])
    seen = boxes(Scene(camera, people), rng, np.zeros(3), False)
    edges = 0.04 * rng.normal(size=(2, len(seen))) * (seen.foot_uv[:, 1] - seen.head_uv[:, 1])
    foot, head = seen.foot_uv.copy(), seen.head_uv.copy()
    foot[:, 1] += edges[0]
    head[:, 1] += edges[1]
    seen = replace(seen, foot_uv=foot, head_uv=head)
    options = CalibrateOptions(lens=camera.lens, orientation="people", lines=False)
    with unchecked():
        found = solve_segments(seen, camera.image_size, options)
    off = errors_of(scene, found)
    return np.append((off / np.maximum(sigmas_of(found), 1e-12))[1:], off[3])


def test_errors_of_the_lower_edge_do_not_pull_the_camera_down(monkeypatch):
    seeds = range(12)
    found = np.array([shallow(seed) for seed in seeds])
    assert (np.sqrt((found[:, :3] ** 2).mean(axis=0)) < 1.2).all()
    fair = np.median(found[:, 3])
    monkeypatch.setattr("scene4d.calibration._lower_edge._LOWER_SHARE", 0.0)
    pulled = np.median([shallow(seed)[3] for seed in seeds])
    # People seen once hide which part of their spread is their height's: half of it stays.
    assert abs(fair) < 0.7 * abs(pulled) and pulled < -0.07
