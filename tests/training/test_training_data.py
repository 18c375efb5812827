"""Training pictures: their cameras must be exactly what is claimed, and their splits clean.

Only what needs no torch: panoramas, invented streets, and the samples made of them.
"""

import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from training.degrade import degraded
from training.fields import field_belief
from training.ground import draw_ground
from training.layout import Box, Layout, invent_layout
from training.panoramas import (
    CELLS,
    CROP_SIZE,
    Panorama,
    View,
    crop,
    fields,
    group,
    read_panoramas,
    split_of,
)
from training.prior import ENTRY, attach, conditional
from training.samples import sample
from training.streets import _Canvas, _paint_box, _paint_ground, street_panorama

from scene4d.core.camera import Camera
from scene4d.perception.orientation import OrientationNetwork
from scene4d.perception.orientation.grid import TILT_RAD, VFOV_RAD

views = st.builds(
    View,
    vfov_rad=st.floats(0.3, 1.3),
    tilt_rad=st.floats(-0.2, 1.0),
    roll_rad=st.floats(-0.3, 0.3),
    heading_rad=st.floats(0, 6.2),
)


def camera_of(view: View) -> Camera:
    """The package's own camera with the same pose, one metre above the ground."""
    focal = CROP_SIZE[1] / 2 / np.tan(view.vfov_rad / 2)
    return Camera.from_pose(
        image_size=CROP_SIZE,
        focal_px=focal,
        tilt_rad=view.tilt_rad,
        roll_rad=view.roll_rad,
        height_m=1.0,
    )


def directions_panorama(columns: int = 2048) -> Panorama:
    """A panorama whose colours are the directions themselves: x, y, z from 0 to 255."""
    rows = columns // 2
    azimuth = (np.arange(columns) + 0.5) / columns * 2 * np.pi
    elevation = np.pi / 2 - (np.arange(rows) + 0.5) / rows * np.pi
    level = np.cos(elevation)[:, None]
    xyz = [
        level * np.sin(azimuth),
        level * np.cos(azimuth),
        np.sin(elevation)[:, None] + 0 * azimuth,
    ]
    return Panorama.of("directions", np.round(127.5 + 127.5 * np.stack(xyz, -1)).astype(np.uint8))


DIRECTIONS = directions_panorama()


@given(views)
@settings(max_examples=25)
def test_crops_look_where_the_camera_looks(view):
    picture = crop(DIRECTIONS, view).astype(float) / 127.5 - 1
    camera = camera_of(view)
    uv = np.array([[20, 20], [96, 71], [180, 40], [60, 130]])
    ray = np.column_stack([(uv - camera.K[:2, 2]) / camera.focal_px, np.ones(4)]) @ camera.R
    x, y, z = ray.T / np.linalg.norm(ray, axis=1)
    c, s = np.cos(view.heading_rad), np.sin(view.heading_rad)
    # One of 255 levels of a colour is 0.008, a tenth of a pixel less.
    expected = np.column_stack([c * x + s * y, c * y - s * x, z])
    np.testing.assert_allclose(picture[uv[:, 1], uv[:, 0]], expected, atol=0.012)


@given(views)
@settings(max_examples=25)
def test_fields_are_those_of_the_camera(view):
    up_uv, latitude = fields(view, CELLS)
    camera = camera_of(view)
    for column, row in ((0, 0), (5, 4), (11, 8), (2, 7)):
        uv = (np.array([column, row]) + 0.5) * 16 - 0.5
        ray = np.append((uv - camera.K[:2, 2]) / camera.focal_px, 1.0) @ camera.R
        assert latitude[row, column] == pytest.approx(np.arcsin(ray[2] / np.linalg.norm(ray)))
        # A point on the ray, and one a little above it.
        foot = camera.centre_m + 5 * ray
        ends, _ = camera.project(foot + np.array([[0, 0, 0], [0, 0, 1e-4]]))
        moved = ends[1] - ends[0]
        np.testing.assert_allclose(up_uv[row, column], moved / np.hypot(*moved), atol=1e-4)


@given(views, st.integers(0, 10**6))
@settings(max_examples=10)
def test_fields_speak_for_their_own_camera(view, seed):
    up_uv, latitude = fields(view, CELLS)
    rng = np.random.default_rng(seed)
    dense = np.concatenate(
        [30 * up_uv.transpose(2, 0, 1), [latitude + rng.normal(0, 0.005, latitude.shape)]]
    )
    dense = np.concatenate([dense, np.full((1, *latitude.shape), np.log(0.05))]).astype(np.float32)
    # At full power the belief is far narrower than a cell of the grid, and snaps to one.
    found = field_belief(dense, 0.2).mean()
    np.testing.assert_allclose(found[:2], [view.roll_rad, view.tilt_rad], atol=np.radians(1.25))
    assert found[2] == pytest.approx(view.vfov_rad, rel=0.07)  # half a cell of the grid, as tilt


def test_a_rendered_box_lies_where_the_camera_projects_it():
    height = 6.0
    box = Box(3.0, 14.0, 0.4, 2.0, 0.9, 0.0, 1.6, "plain", np.full(3, 255.0, np.float32))
    layout = Layout("street", height, 0.0, 5.0, 8.0, None, [box])
    canvas = _Canvas(4096, 2048)
    _paint_box(canvas, box, layout)
    panorama = Panorama.of("box", (np.clip(canvas.colour, 0, 255) > 60).astype(np.uint8) * 255)
    view = View(np.radians(40), np.radians(20), np.radians(5), 0.0)
    seen = crop(panorama, view)[..., 0] > 127
    camera = Camera.from_pose(
        image_size=CROP_SIZE,
        focal_px=CROP_SIZE[1] / 2 / np.tan(np.radians(20)),
        tilt_rad=view.tilt_rad,
        roll_rad=view.roll_rad,
        height_m=height,
    )
    uv, _ = camera.project(box.corners())
    hull = cv2.convexHull(np.round(uv * 16).astype(np.int32))
    drawn = np.zeros(seen.shape, np.uint8)
    cv2.fillConvexPoly(drawn, hull, 1, shift=4)
    union, both = (seen | (drawn > 0)).sum(), (seen & (drawn > 0)).sum()
    assert union > 400
    assert both / union > 0.93


def test_a_sheared_world_slopes_and_its_uprights_stay_upright():
    """A place on the slope, and one above it, show what stood level there."""
    slope = np.array([0.2, -0.1])
    view = View(np.radians(50), np.radians(20), np.radians(6), 1.1, slope=tuple(slope))
    camera, picture = camera_of(view), crop(DIRECTIONS, view).astype(float) / 127.5 - 1
    for right, ahead in ((0.0, 3.0), (0.8, 4.0), (-1.0, 6.0)):
        rise = slope @ [right, ahead]
        for above in (0.0, 0.3):
            (uv,), _ = camera.project(np.array([[right, ahead, rise + above]]))
            u, v = np.round(uv).astype(int)
            level = np.array([right, ahead, above - 1.0])  # as seen from one metre up
            c, s = np.cos(view.heading_rad), np.sin(view.heading_rad)
            turned = [c * level[0] + s * level[1], c * level[1] - s * level[0], level[2]]
            np.testing.assert_allclose(picture[v, u], turned / np.linalg.norm(turned), atol=0.02)


@pytest.mark.parametrize("surface", ["plain", "facade"])
def test_boxes_stand_on_sloping_ground(surface):
    """People slope with the ground at their feet, houses are level and reach down to it."""
    box = Box(2.0, 13.0, 0.4, 2.0, 0.9, 0.0, 1.6, surface, np.full(3, 255.0, np.float32))
    layout = Layout("street", 6.0, 0.0, 5.0, 8.0, None, [box], slope=(0.15, 0.2))
    canvas = _Canvas(4096, 2048)
    _paint_box(canvas, box, layout)
    lit = np.isfinite(canvas.distance)
    rows, columns = np.nonzero(lit)
    x, y, z = (
        part[rows, columns] * canvas.distance[lit]
        for part in np.broadcast_arrays(*canvas.rays(np.arange(2048), np.arange(4096)))
    )
    ground = layout.rise_m(np.column_stack([x, y]))
    height = z + 6.0 - ground
    if surface == "plain":
        assert height.min() == pytest.approx(0.0, abs=0.03)
        assert height.max() == pytest.approx(1.6, abs=0.03)
    else:
        assert (z + 6.0).max() == pytest.approx(layout.standing(box).top_m, abs=0.03)
        assert height.min() < 0 and (z + 6.0).max() > ground.max() + 1.0


def test_a_slope_is_painted_where_it_lies():
    """The ground's colours are those of the level drawing, at the same places seen from above."""
    layout = invent_layout(np.random.default_rng(4))
    level, sloping = (_Canvas(720, 360) for _ in range(2))
    ground = draw_ground(layout, [], np.random.default_rng(1))
    _paint_ground(level, replace(layout, slope=(0.0, 0.0)), ground)
    _paint_ground(sloping, replace(layout, slope=(0.3, 0.0)), ground)
    rows, columns = np.arange(360), np.arange(720)
    x, _, z = np.broadcast_arrays(*sloping.rays(rows, columns))
    hit = np.isfinite(sloping.distance)
    height = (z * sloping.distance)[hit] + layout.camera_height_m
    np.testing.assert_allclose(height, 0.3 * (x * sloping.distance)[hit], atol=1e-3)
    # Ahead, where the slope's ground is as high as the foot, nothing has changed.
    np.testing.assert_allclose(sloping.distance[200:, 0], level.distance[200:, 0], rtol=0.02)
    assert hit[:180].any(), "uphill, the ground reaches above the horizon"


def test_a_street_has_a_level_ground_below_and_sky_above():
    panorama = street_panorama(3, [], size=(512, 256))
    picture = panorama.levels[0]
    assert picture.shape == (256, 512, 3)
    assert picture.std() > 10
    np.testing.assert_array_equal(picture, street_panorama(3, [], size=(512, 256)).levels[0])
    assert (picture != street_panorama(4, [], size=(512, 256)).levels[0]).any()
    heights = [invent_layout(np.random.default_rng(n)).camera_height_m for n in range(200)]
    assert 2.2 <= min(heights) < 3 and 12 < max(heights) <= 15


def test_samples_are_a_function_of_the_seed():
    one, truth = sample(np.random.default_rng([1, 2]), [DIRECTIONS], [])
    again, _ = sample(np.random.default_rng([1, 2]), [DIRECTIONS], [])
    other, _ = sample(np.random.default_rng([1, 3]), [DIRECTIONS], [])
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    assert one.shape == (CROP_SIZE[1], CROP_SIZE[0], 3) and one.dtype == np.uint8
    assert np.isfinite(truth.up_uv).all() and np.isfinite(truth.latitude_rad).all()


def test_mirrored_samples_keep_their_truth():
    """Left and right of a mirrored crop are exchanged, and its roll has the other sign."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(12):
        picture, truth = sample(rng, [DIRECTIONS], [], clean=True)
        seen.add(truth.view.mirrored)
        z = picture[..., 2].astype(float) / 127.5 - 1
        rows = (np.arange(9) * 16 + 8).astype(int)
        columns = (np.arange(12) * 16 + 8).astype(int)
        found = np.arcsin(np.clip(z[np.ix_(rows, columns)], -1, 1))
        # Half a pixel beside the cells' centres; steep views are left out.
        np.testing.assert_allclose(found, truth.latitude_rad, atol=0.06)
    assert seen == {True, False}


def test_every_kind_of_degradation_keeps_the_picture_a_picture():
    rng = np.random.default_rng(0)
    picture = crop(DIRECTIONS, View(0.8, 0.3, 0.0, 1.0))
    for _ in range(150):
        out = degraded(picture, rng)
        assert out.shape == picture.shape and out.dtype == np.uint8


def test_trained_tilts_are_those_that_are_drawn():
    """Independent of the field of view where they are drawn so, and never none."""
    rng = np.random.default_rng(0)
    tilt, vfov = np.radians(rng.uniform(0, 40, 20_000)), np.radians(rng.uniform(20, 60, 20_000))
    p = np.exp(conditional(tilt, vfov))
    np.testing.assert_allclose(p.sum(axis=0), 1)
    drawn = (np.radians(3) < TILT_RAD) & (np.radians(37) > TILT_RAD)
    wide = (np.radians(22) < VFOV_RAD) & (np.radians(55) > VFOV_RAD)
    # A cell of 2.5° out of 40°, less what is spread evenly.
    np.testing.assert_allclose(p[np.ix_(drawn, wide)], 2.5 / 40, rtol=0.15)
    assert p[-1, wide].max() < 0.01 and p.min() > 1e-4


def test_the_packaged_network_says_how_often_tilts_were_trained():
    """Steep cameras are rarer in training, for narrow and for wide fields of view."""
    entry = OrientationNetwork()._session.get_modelmeta().custom_metadata_map[ENTRY]
    p = np.exp(np.array(json.loads(entry)))
    np.testing.assert_allclose(p.sum(axis=0), 1, rtol=0.02)
    at = [np.abs(np.degrees(TILT_RAD) - value).argmin() for value in (20, 65)]
    assert (p[at[0]] > 1.2 * p[at[1]]).all()
    network = onnx.ModelProto()
    attach(network, np.log(p))
    (kept,) = network.metadata_props
    np.testing.assert_allclose(np.exp(json.loads(kept.value)), p, rtol=2e-3)


def test_neighbouring_panoramas_share_a_split(shared_data):
    with (shared_data / "panoramas" / "SOURCES.csv").open(newline="") as file:
        names = [row["file"] for row in csv.DictReader(file)]
    of_group: dict[str, set[str]] = {}
    for name in names:
        of_group.setdefault(group(name), set()).add(split_of(name))
    assert all(len(splits) == 1 for splits in of_group.values())
    assert group("pypi-geovisio_street1.jpg") == group("pypi-geovisio_street4.jpg")
    counts = {name: sum(split_of(file) == name for file in names) for name in ("train", "test")}
    assert counts["test"] >= 20 and counts["train"] >= 90
    validation = read_panoramas(shared_data / "panoramas", "validation")
    assert all(panorama.levels[0].shape[1] >= 1024 for panorama in validation)
