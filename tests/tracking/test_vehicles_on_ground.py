"""Vehicles on the ground: projections against OpenCV, coverage, cut boxes, parked vehicles."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from benchmarks.vehicle_positions import (
    NOISE_PX,
    NOISE_SHARE,
    PROFILES,
    Drawn,
    body,
    bottom_centre,
    boxes_of,
    draw,
    heading_error,
    inside_ellipse,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import VEHICLES, Located
from scene4d.core.vehicle_shapes import CUBOID, SHAPES, VehicleShape
from scene4d.tracking._vehicle_fit import Outline, cholesky, solve
from scene4d.tracking._vehicles import locate_vehicles
from strategies import build_camera, build_lens, cameras

STREET = build_camera(build_lens((1920, 1080), 50.0, radial=(-0.06, 0, 0)), 18.0, 3.0, 7.0, 30.0)


def random_cameras(count: int, rng: np.random.Generator) -> list[Camera]:
    """Cameras over a street: any lens, tilt, roll, height, heading and position."""
    return [
        build_camera(
            build_lens(
                (1920, 1080),
                rng.uniform(20, 80),
                rng.uniform(0.95, 1.05),
                tuple(rng.uniform(-0.04, 0.04, 2)),
                (rng.uniform(-0.08, 0.08), rng.uniform(-0.01, 0.01), 0.0),
                tuple(rng.uniform(-0.002, 0.002, 2)),
            ),
            tilt_deg=rng.uniform(8, 55),
            roll_deg=rng.uniform(-10, 10),
            height_m=rng.uniform(4, 20),
            heading_deg=rng.uniform(-180, 180),
            xy_m=tuple(rng.uniform(-300, 300, 2)),
        )
        for _ in range(count)
    ]


@pytest.fixture(scope="module")
def cars() -> list[Drawn]:
    rng = np.random.default_rng(0)
    return [draw(camera, 250, rng) for camera in random_cameras(12, rng)]


@pytest.fixture(scope="module")
def located(cars: list[Drawn]) -> list[Located]:
    return [locate_vehicles(d.detections, d.camera) for d in cars]


def errors(found: list[Located], drawn: list[Drawn]) -> np.ndarray:
    return np.concatenate(
        [np.hypot(*(f.xy_m - d.xy_m).T) for f, d in zip(found, drawn, strict=True)]
    )


def coverage(found: list[Located], drawn: list[Drawn]) -> float:
    inside = [inside_ellipse(f, d.xy_m) for f, d in zip(found, drawn, strict=True)]
    return float(np.concatenate(inside).mean())


def of(camera: Camera, boxes: np.ndarray, names: object = "car", track=None) -> Detections:
    boxes = np.asarray(boxes, float).reshape(-1, 4)
    names = np.full(len(boxes), names) if isinstance(names, str) else np.asarray(names)
    return Detections.from_boxes(
        camera.image_size, np.arange(len(boxes)), boxes, class_name=names, track=track
    )


def states(camera: Camera, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random states (6, n, 1) of vehicles in view and not too near."""
    uv = rng.uniform(0.2, 0.8, (20 * count, 2)) * camera.image_size
    xy, valid = camera.locate(uv)
    far = np.hypot(*(xy - camera.centre_m[:2]).T)
    xy = xy[valid & (far > 15) & (far < 80)][:count]
    free = rng.normal(0, 0.15, (3, len(xy)))
    heading = rng.uniform(-3, 3, (1, len(xy)))
    return np.concatenate([free, heading, xy.T])[:, :, None]


@pytest.mark.parametrize("points", [CUBOID, SHAPES["car"].points, SHAPES["bicycle"].points])
def test_the_outline_is_that_of_opencv(points):
    """All points of every vehicle through cv2.projectPoints, one by one."""
    rng = np.random.default_rng(3)
    shape = replace(SHAPES["car"], points=points)
    compared = 0
    for camera in random_cameras(6, rng):
        state = states(camera, 10, rng)
        edges, _, _ = Outline(camera, shape).project(state)
        for row in range(state.shape[1]):
            size = shape.size_m * np.exp(state[:3, row, 0])
            heading, x, y = state[3:, row, 0]
            c, s = np.cos(heading), np.sin(heading)
            turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            world = (points * size) @ turn.T + [x, y, 0]
            uv, _ = cv2.projectPoints(
                world, cv2.Rodrigues(camera.R)[0], camera.t, camera.K, camera.distortion
            )
            low, high = uv[:, 0].min(axis=0), uv[:, 0].max(axis=0)
            if (low < 0).any() or (high > camera.image_size).any():
                continue  # outside the picture the lens is continued, not folded
            np.testing.assert_allclose(edges[:, row, 0], [*low, *high], atol=1e-6)
            compared += 1
    assert compared > 30


def test_beyond_the_picture_the_lens_does_not_fold_back():
    camera = build_camera(build_lens((1280, 720), 70.0, radial=(-0.25, 0, 0)), 20.0, 0.0, 6.0)
    shape = SHAPES["car"]
    right = np.linspace(0.0, 40.0, 60)  # a car that drives out of the picture to the right
    state = np.zeros((6, 60, 1))
    state[4, :, 0], state[5, :, 0] = right, 14.0
    edges, _, _ = Outline(camera, shape).project(state)
    assert (np.diff(edges[0, :, 0]) > 0).all()
    assert (np.diff(edges[2, :, 0]) > 0).all()


def test_slopes_are_those_of_finite_differences():
    rng = np.random.default_rng(4)
    camera = build_camera(build_lens((1920, 1080), 40.0), 15.0, 5.0, 8.0, 70.0, (20.0, -7.0))
    outline = Outline(camera, SHAPES["car"])
    state = states(camera, 40, rng)
    _, uv, fractions = outline.project(state)
    lens = outline.lens_slope(uv[0, :, :, 0].T)
    slopes = outline.slopes(state, uv, fractions, lens)
    for i in range(6):
        step = np.zeros((6, 1, 1))
        step[i] = 1e-6
        ends = [outline.project(state + sign * step) for sign in (-1, 1)]
        same = (ends[0][2] == ends[1][2]).all(axis=1)  # no other point takes over
        number = (ends[1][0] - ends[0][0]) / 2e-6
        np.testing.assert_allclose(slopes[:, i][same], number[same], rtol=1e-4, atol=1e-3)
        assert same.mean() > 0.9


def test_the_lens_slope_is_that_of_finite_differences():
    uv = np.array([[300.0, 200.0], [960.0, 540.0], [1700.0, 900.0]])
    slope = Outline(STREET, SHAPES["car"]).lens_slope(uv)
    for axis in range(2):
        step = np.eye(2)[axis] * 1e-3
        number = (STREET.distort(uv + step)[0] - STREET.distort(uv - step)[0]) / 2e-3
        np.testing.assert_allclose(slope[:, axis].T, number, atol=1e-5)


def test_small_systems_are_solved_as_numpy_does():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(50, 6, 6))
    matrix, right = root @ root.swapaxes(1, 2) + np.eye(6), rng.normal(size=(50, 6))
    stacked = np.moveaxis(matrix, 0, -1)
    x = solve(cholesky(stacked), right.T.copy())
    np.testing.assert_allclose(x.T, np.linalg.solve(matrix, right[..., None])[..., 0], rtol=1e-8)


def test_ellipses_contain_the_truth_and_errors_are_far_below_the_bottom_centre(cars, located):
    error = np.median(errors(located, cars))
    base = np.median(
        np.concatenate(
            [np.hypot(*(bottom_centre(d.camera, d.detections) - d.xy_m).T) for d in cars]
        )
    )
    share = coverage(located, cars)
    print(f"\ncars: {share:.1%} in 95 % ellipses, median {error:.2f} m, box bottom {base:.2f} m")
    assert sum(map(len, located)) > 1000
    assert all(f.known.all() for f in located)
    assert 0.93 < share < 0.98
    assert error < 0.3 * base


@pytest.mark.parametrize("name", ["truck", "bus", "motorcycle", "bicycle"])
def test_every_class_keeps_its_promise(name):
    rng = np.random.default_rng(1)
    drawn = [draw(camera, 200, rng, name) for camera in random_cameras(6, rng)]
    found = [locate_vehicles(d.detections, d.camera) for d in drawn]
    assert 0.90 < coverage(found, drawn) < 0.99
    base = [bottom_centre(d.camera, d.detections) - d.xy_m for d in drawn]
    assert np.median(errors(found, drawn)) < 0.4 * np.median(np.hypot(*np.concatenate(base).T))


@pytest.mark.parametrize("profile", sorted(PROFILES))
def test_bodies_that_the_fit_does_not_know_are_covered(profile):
    rng = np.random.default_rng(2)
    drawn = [draw(c, 120, rng, points=body(profile)) for c in random_cameras(8, rng)]
    found = [locate_vehicles(d.detections, d.camera) for d in drawn]
    assert 0.85 < coverage(found, drawn) < 0.99
    assert np.median(errors(found, drawn)) < 0.5


def test_headings_are_axes_with_honest_spreads(cars, located):
    off = np.concatenate(
        [heading_error(f, d.heading_rad) for f, d in zip(located, cars, strict=True)]
    )
    sigma = np.concatenate([f.heading_sigma_rad for f in located])
    told = np.isfinite(off)
    assert all(f.heading_is_axis.all() for f in located)
    assert (np.isfinite(sigma) == told).all()
    assert 0.5 < told.mean() < 0.95  # a box often tells something, not always
    assert 0.90 < (np.abs(off[told]) < 2 * sigma[told]).mean() < 0.995
    # What is called sure is better than what is called unsure.
    sure = sigma < np.nanmedian(sigma)
    assert np.median(np.abs(off[told & sure])) < 0.7 * np.median(np.abs(off[told & ~sure]))


@pytest.mark.parametrize("sigma", [0.02, 0.2, 0.6])
def test_a_given_heading_helps_and_is_no_axis(cars, located, sigma):
    rng = np.random.default_rng(6)
    found = []
    for d in cars:
        n = len(d.detections)
        told = d.heading_rad + sigma * rng.normal(size=n)
        found.append(
            locate_vehicles(
                d.detections, d.camera, heading_rad=told, heading_sigma_rad=np.full(n, sigma)
            )
        )
    assert not any(f.heading_is_axis.any() for f in found)
    assert 0.93 < coverage(found, cars) < 0.98
    off = np.concatenate(
        [heading_error(f, d.heading_rad) for f, d in zip(found, cars, strict=True)]
    )
    spread = np.concatenate([f.heading_sigma_rad for f in found])
    known = np.isfinite(off)
    assert 0.90 < (np.abs(off[known]) < 2 * spread[known]).mean() < 0.99
    if sigma < 0.5:
        assert np.median(errors(found, cars)) < 0.95 * np.median(errors(located, cars))
        area = np.concatenate([np.linalg.det(f.covariance_m2) for f in found])
        before = np.concatenate([np.linalg.det(f.covariance_m2) for f in located])
        assert np.median(area / before) < 0.95


def test_headings_where_they_are_known(cars, located):
    """Unknown and useless headings leave a row as it is without."""
    d, n = cars[0], len(cars[0].detections)
    heading, sigma = np.full(n, np.nan), np.full(n, 0.1)
    heading[: n // 3] = d.heading_rad[: n // 3]
    heading[n // 3 : 2 * n // 3], sigma[n // 3 : 2 * n // 3] = 1.0, 5.0
    sigma[-1] = np.nan
    found = locate_vehicles(d.detections, d.camera, heading_rad=heading, heading_sigma_rad=sigma)
    assert (found.heading_is_axis == (np.arange(n) >= n // 3)).all()
    np.testing.assert_array_equal(found.xy_m[n // 3 :], located[0].xy_m[n // 3 :])


def test_a_typical_car_without_noise_is_found():
    heading, xy = np.array([0.3, 1.2, -2.0]), np.array([[2.0, 30.0], [-10.0, 25.0], [-5.0, 22.0]])
    shape = SHAPES["car"]
    boxes, _ = boxes_of(STREET, shape.points, np.tile(shape.size_m, (3, 1)), heading, xy)
    found = locate_vehicles(
        of(STREET, boxes), STREET, heading_rad=heading, heading_sigma_rad=np.full(3, 0.01)
    )
    np.testing.assert_allclose(found.xy_m, xy, atol=0.02)
    np.testing.assert_allclose(found.heading_rad, heading, atol=0.01)


def test_a_quarter_turn_of_the_world_turns_the_answer(cars, located):
    """The starting headings map onto themselves, so the answers agree to the last digits."""
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for d, before in zip(cars[:4], located[:4], strict=True):
        found = locate_vehicles(d.detections, replace(d.camera, R=d.camera.R @ quarter.T))
        np.testing.assert_allclose(found.xy_m, before.xy_m @ quarter[:2, :2].T, atol=1e-5)
        np.testing.assert_allclose(
            found.heading_sigma_rad, before.heading_sigma_rad, rtol=1e-4, equal_nan=True
        )
        off = heading_error(found, before.heading_rad + np.pi / 2)
        assert np.nanmax(np.abs(off)) < 1e-4


def test_all_at_once_is_one_by_one(cars, located):
    d = cars[3]
    names = np.array([VEHICLES[i % 5] for i in range(len(d.detections))])
    mixed = replace(d.detections, class_name=names)
    together = locate_vehicles(mixed, d.camera)
    order = np.random.default_rng(0).permutation(len(mixed))
    shuffled = locate_vehicles(mixed.select(order), d.camera)
    np.testing.assert_allclose(shuffled.xy_m, together.xy_m[order], atol=1e-9)
    for row in range(0, len(mixed), 9):
        alone = locate_vehicles(mixed.select(np.array([row])), d.camera)
        np.testing.assert_allclose(alone.xy_m[0], together.xy_m[row], atol=1e-9)
        np.testing.assert_allclose(
            alone.covariance_m2[0], together.covariance_m2[row], rtol=1e-6, atol=1e-12
        )


def test_more_vehicles_than_fit_one_chunk():
    drawn = draw(STREET, 150, np.random.default_rng(0)).detections
    rows = np.arange(700) % len(drawn)
    few = locate_vehicles(drawn, STREET)
    many = locate_vehicles(drawn.select(rows), STREET)
    np.testing.assert_allclose(many.xy_m, few.xy_m[rows], atol=1e-9)


@pytest.fixture(scope="module")
def cut_cars() -> list[tuple[Drawn, Located]]:
    rng = np.random.default_rng(7)
    drawn = [draw(camera, 800, rng, cut=True) for camera in random_cameras(5, rng)]
    return [(d, locate_vehicles(d.detections, d.camera)) for d in drawn]


@pytest.mark.parametrize("sides", [1, 2])
def test_cut_boxes_are_placed_less_surely(cut_cars, sides):
    error, base, inside, spread, whole = [], [], [], [], []
    for d, found in cut_cars:
        cut = (d.cut_sides == sides) & found.known
        away = np.hypot(*(d.xy_m - d.camera.centre_m[:2]).T)
        sigma = np.sqrt(np.linalg.eigvalsh(found.covariance_m2)[:, 1]) / away
        part = found.select(cut)
        inside.append(inside_ellipse(part, d.xy_m[cut]))
        error.append(np.hypot(*(part.xy_m - d.xy_m[cut]).T))
        base.append(np.hypot(*(bottom_centre(d.camera, d.detections) - d.xy_m)[cut].T))
        spread.append(sigma[cut])
        whole.append(sigma[d.cut_sides == 0])
    assert len(np.concatenate(inside)) > 100
    assert 0.90 < np.concatenate(inside).mean() <= 0.995
    assert np.median(np.concatenate(error)) < 0.7 * np.median(np.concatenate(base))
    assert np.median(np.concatenate(spread)) > 1.3 * np.median(np.concatenate(whole))


def test_a_box_cut_on_every_side_has_no_place():
    width, height = STREET.image_size
    around = [[0, 0, width, height], [-5, 300, width + 5, 700], [0, 0, width - 1, 800]]
    found = locate_vehicles(of(STREET, around), STREET)
    assert not found.known.any()
    assert np.isnan(found.covariance_m2).all()


def test_far_vehicles_near_the_horizon_are_unsure_and_still_right():
    camera = build_camera(build_lens((1920, 1080), 60.0), 10.0, 0.0, 5.0)
    rng, n = np.random.default_rng(8), 400
    shape = SHAPES["car"]
    xy = np.column_stack([rng.uniform(-30, 30, n), rng.uniform(150, 300, n)])
    heading = rng.uniform(-np.pi, np.pi, n)
    size = shape.size_m * np.exp(rng.multivariate_normal(np.zeros(3), shape.log_covariance, n))
    boxes, _ = boxes_of(camera, shape.points, size, heading, xy)
    extent = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
    boxes += rng.normal(size=boxes.shape) * np.hypot(NOISE_PX, NOISE_SHARE * extent)
    found = locate_vehicles(of(camera, boxes), camera)
    assert found.known.all()
    sigma = np.sqrt(found.covariance_m2[:, 1, 1])
    assert np.median(sigma) > 5.0
    assert 0.85 < inside_ellipse(found, xy).mean() < 0.99


def test_what_no_vehicle_on_the_ground_explains_has_no_place():
    """Boxes in the sky, and one as large as a house."""
    camera = build_camera(build_lens((1920, 1080), 60.0), 10.0, 0.0, 5.0)
    sky = [[900, 5, 1000, 40], [100, 10, 160, 30], [800, 100, 900, 160], [800, 200, 820, 210]]
    found = locate_vehicles(of(camera, [*sky, [200, 50, 1200, 600]]), camera)
    assert not found.known.any()


def test_a_half_hidden_vehicle_is_less_sure(cars, located):
    """The lower 40 % of every car hidden: the box contradicts the ground, and that is said."""
    hidden = []
    for d in cars:
        box = d.detections.box_xyxy.copy()
        box[:, 3] -= 0.4 * (box[:, 3] - box[:, 1])
        hidden.append(locate_vehicles(replace(d.detections, box_xyxy=box), d.camera))
    area = [
        np.concatenate([np.linalg.det(f.covariance_m2) for f in fs]) for fs in (hidden, located)
    ]
    assert np.nanmedian(area[0] / area[1]) > 1.5


def test_rows_that_are_no_vehicles_or_no_boxes_have_no_place():
    good = [800.0, 500.0, 950.0, 600.0]
    boxes = [good, good, [np.nan, 1, 2, 3], [900, 500, 850, 600], [900, 500, 900, 600], good, good]
    names = ["person", "car", "car", "car", "car", "dog", "vehicle"]
    found = locate_vehicles(of(STREET, boxes, names), STREET)
    assert found.known.tolist() == [False, True, False, False, False, False, True]
    assert 0 < np.linalg.norm(found.xy_m[1] - found.xy_m[6]) < 0.5
    assert np.isnan(found.heading_sigma_rad[0])


@pytest.mark.parametrize("kind", ["car", "truck"])
def test_a_vehicle_of_unknown_kind_may_be_any(kind):
    """The ellipse holds whatever it is; a lorry is placed better than if it were told a car."""
    rng, n = np.random.default_rng(4), 300
    shape = SHAPES[kind]
    uv = rng.uniform((0.25, 0.35), (0.75, 0.7), (n, 2)) * STREET.image_size
    xy = STREET.locate(uv)[0]
    heading = rng.uniform(-np.pi, np.pi, n)
    size = shape.size_m * np.exp(rng.multivariate_normal(np.zeros(3), shape.log_covariance, n))
    boxes, _ = boxes_of(STREET, shape.points, size, heading, xy)
    last = np.array(STREET.image_size) - 6
    inside = (boxes[:, :2] > 5).all(axis=1) & (boxes[:, 2:] < last).all(axis=1)
    boxes, xy = boxes[inside], xy[inside]
    found = {name: locate_vehicles(of(STREET, boxes, name), STREET) for name in ("car", "vehicle")}
    assert inside_ellipse(found["vehicle"], xy).mean() > 0.85
    error = {name: np.median(np.linalg.norm(one.xy_m - xy, axis=1)) for name, one in found.items()}
    if kind == "truck":
        assert error["vehicle"] < 0.9 * error["car"], "its size does not tell the distance"
    else:
        assert error["vehicle"] < 1.5 * error["car"]


def test_nothing_in_nothing_out():
    assert len(locate_vehicles(of(STREET, np.empty((0, 4))), STREET)) == 0


def test_bad_input_is_named():
    boxes = of(STREET, [[800, 500, 950, 600]])
    other = build_camera(build_lens((1280, 720)))
    with pytest.raises(InputError, match=r"1920, 1080.*1280, 720.*camera of this footage"):
        locate_vehicles(boxes, other)
    with pytest.raises(InputError, match="heading_sigma_rad together"):
        locate_vehicles(boxes, STREET, heading_rad=np.zeros(1))
    with pytest.raises(InputError, match="1 detections, 2 headings"):
        locate_vehicles(boxes, STREET, heading_rad=np.zeros(2), heading_sigma_rad=np.ones(2))
    with pytest.raises(InputError, match=r"must be positive, found 0.0 in row 0"):
        locate_vehicles(boxes, STREET, heading_rad=np.zeros(1), heading_sigma_rad=np.zeros(1))


NUMBERS = st.one_of(st.floats(-500, 2500), st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e9]))


@settings(max_examples=40)
@given(
    camera=cameras(anywhere=True),
    boxes=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6),
    names=st.lists(st.sampled_from(VEHICLES), min_size=6, max_size=6),
)
def test_any_box_gives_a_place_with_a_covariance_or_none(camera, boxes, names):
    found = locate_vehicles(of(camera, boxes, names[: len(boxes)]), camera)
    known = found.known
    assert (np.linalg.eigvalsh(found.covariance_m2[known]) > 0).all()
    assert np.isnan(found.covariance_m2[~known]).all()
    assert np.isnan(found.heading_rad[~known]).all()
    assert (np.isnan(found.heading_rad) == np.isnan(found.heading_sigma_rad)).all()


def test_shapes_are_what_they_say():
    assert set(VEHICLES) <= set(SHAPES)
    for name, shape in SHAPES.items():
        assert isinstance(shape, VehicleShape), name
        assert (np.linalg.eigvalsh(shape.log_covariance) > 0).all()
        # The outline touches every side of its cuboid, and leaves it nowhere.
        np.testing.assert_allclose(shape.points.min(axis=0), [-0.5, -0.5, 0.0], atol=1e-12)
        np.testing.assert_allclose(shape.points.max(axis=0), [0.5, 0.5, 1.0], atol=1e-12)
        mirrored = {tuple(p) for p in shape.points * [-1, 1, 1] + 0.0}
        assert mirrored == {tuple(p) for p in shape.points + 0.0}
    assert len(CUBOID) == 8
