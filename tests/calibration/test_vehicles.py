"""Vehicles as rulers: what they say of the camera, how surely, and when they are asked."""

import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import parameters_of
from traffic_scenes import drive, street_camera

from scene4d.calibration import solve_segments
from scene4d.calibration._body import Points
from scene4d.calibration._case import ImageFrame
from scene4d.calibration._prior import default_prior
from scene4d.calibration._problem import Noise, Problem, State
from scene4d.calibration._refine import minimise
from scene4d.calibration._traffic import Traffic
from scene4d.calibration._uncertainty import covariance
from scene4d.calibration._watching_vehicles import annotated_vehicles
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, needs_vehicles, noted_annotations
from scene4d.core.camera import Camera
from scene4d.core.people import Detections, Segments
from scene4d.formats.cameras import read_calibration
from strategies import build_camera, build_lens
from type_checks import unchecked

PEOPLE_ONLY = CalibrateOptions(orientation="people", estimate_distortion=False, lines=False)
NOBODY = Segments.from_points(np.empty((0, 2)), np.empty((0, 2)))


def _camera() -> Camera:
    return build_camera(build_lens((1280, 720), 50), 15.0, 2.0, 8.0)


def _traffic(camera: Camera, detections: Detections) -> Traffic:
    found = Traffic.of(detections, ImageFrame(camera.image_size))
    assert found is not None
    return found


def test_the_gradient_is_that_of_the_cost() -> None:
    camera = _camera()
    vehicles = _traffic(camera, drive(camera, np.random.default_rng(1), roads=2)).vehicles
    truth = parameters_of(camera)
    for at in (truth, truth + np.array([0.05, 0.02, 0.01, 0.05, 0.01, 0.01, -0.01])):
        steps = 2e-3 * np.eye(7)
        numeric = [(vehicles.at(at + s).cost - vehicles.at(at - s).cost) / 8e-3 for s in steps]
        # Where another point of an outline touches an edge, the cost has a kink.
        np.testing.assert_allclose(vehicles.at(at).gradient, numeric, rtol=0.15, atol=2.0)


def test_vehicles_of_typical_size_have_their_least_cost_at_the_true_camera() -> None:
    camera = _camera()
    seen = drive(camera, np.random.default_rng(2), roads=2, jitter=0, shape=0, fleet=0, spread=0)
    vehicles = _traffic(camera, seen).vehicles
    truth = parameters_of(camera)
    value = vehicles.at(truth)
    assert value.cost < 0.3
    step = np.linalg.solve(value.hessian + np.eye(7), value.gradient)
    assert np.abs(step).max() < 0.01
    for away in ([0.3, 0, 0, 0, 0, 0, 0], [0, 0.1, 0, 0, 0, 0, 0], [0, 0, 0, 0.3, 0, 0, 0]):
        assert vehicles.at(truth + away).cost > value.cost + 2


def test_errors_are_as_large_as_stated() -> None:
    z = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        camera = street_camera(rng)
        seen = drive(camera, rng, roads=1 + seed % 2, bend_per_m=0.02 * (seed % 3 == 0))
        found = Traffic.of(seen, ImageFrame(camera.image_size))
        if found is None or len(found) < 8:
            continue
        none = np.empty((2, 0))
        points = Points(none, none, np.empty(0, bool), 0.0)
        problem = Problem(
            points, np.empty(0, int), np.empty(0), 1.7, default_prior(), terms=(found.vehicles,)
        )
        truth = parameters_of(camera)
        with unchecked():
            state = minimise(problem, State(truth, np.empty(0), Noise()), steps=6, tolerance=0.02)
        sigma = np.sqrt(np.diag(covariance(problem, state))[:4])
        z.append((state.parameters - truth)[:4] / sigma)
    rms = np.sqrt(np.mean(np.square(z), axis=0))
    assert len(z) >= 6
    assert np.abs(z).max() < 3.5
    assert ((rms > 0.2) & (rms < 1.5)).all(), rms


def test_a_camera_without_people_and_what_its_scale_rests_on() -> None:
    """Two vehicles of a wrong class and a tenth of hidden ones are outliers."""
    camera, rng = _camera(), np.random.default_rng(4)
    seen = drive(camera, rng, 30, roads=2)
    box, kind = seen.box_xyxy.copy(), seen.class_name.copy()
    kind[np.isin(seen.track, (0, 7))] = "bus"
    hidden = rng.random(len(seen)) < 0.1
    box[hidden, 3] -= 0.4 * (box[hidden, 3] - box[hidden, 1])
    spoilt = replace(seen, box_xyxy=box, class_name=kind)
    options = replace(PEOPLE_ONLY, lens=camera.lens)
    found = solve_segments(NOBODY, camera.image_size, options, vehicles=spoilt)
    assert found.camera is not None
    error = parameters_of(found.camera)[1:4] - parameters_of(camera)[1:4]
    assert np.abs(error / np.sqrt(np.diag(found.parameter_covariance)[1:4])).max() < 3
    assert found.vehicles is not None
    assert len(found.vehicles) < len(_traffic(camera, spoilt).detections)
    assert found.people == 0
    assert found.to_dict()["vehicles"] == found.vehicle_count >= 5
    assert any("The scale rests on" in text and "vehicles" in text for text in found.warnings)
    assert found.ground_error_m is not None
    assert np.isfinite(found.ground_error_m["median"])


def test_too_few_vehicles_are_refused() -> None:
    camera = _camera()
    few = drive(camera, np.random.default_rng(6), 3, roads=2)
    found = solve_segments(NOBODY, camera.image_size, PEOPLE_ONLY, vehicles=few)
    assert found.reason is not None
    assert "at least 3 are needed, or 5 moving vehicles" in found.reason


def test_parked_cut_and_hidden_vehicles_are_left_out() -> None:
    def rows(x: float, step: float, track: int) -> Detections:
        n = 12
        left = x + step * np.arange(n)
        box = np.column_stack([left, np.full(n, 300.0), left + 90, np.full(n, 360.0)])
        return Detections.from_boxes(
            (1280, 720), np.arange(n), box, track=np.full(n, track), class_name=np.full(n, "car")
        )

    parked, driving = rows(100, 0.3, 0), rows(300, 30.0, 1)
    cut = rows(0.0, 0.0, 2)
    nearer = replace(rows(300, 30.0, 3), box_xyxy=rows(300, 30.0, 3).box_xyxy + 20.0)
    frame = ImageFrame((1280, 720))

    def used(*parts: Detections) -> set[int]:
        every = Detections.concatenate(parts)
        found = Traffic.of(every.select(np.argsort(every.frame, kind="stable")), frame)
        return set() if found is None else set(found.detections.track.tolist())

    assert used(parked, driving, cut) == {1}
    assert used(driving, nearer) == {3}
    assert used(parked, cut) == set()


def test_vehicles_are_asked_where_people_do_not_determine_the_camera() -> None:
    camera = _camera()
    seen = Seen(drive(camera, np.random.default_rng(7)), 40)
    seen.detections = replace(seen.detections, class_name=np.full(len(seen.detections), "car"))
    assert needs_vehicles(seen, PEOPLE_ONLY)
    assert not needs_vehicles(seen, replace(PEOPLE_ONLY, vehicles="never"))
    assert not needs_vehicles(seen, replace(PEOPLE_ONLY, method="paper", orientation="network"))
    tracked = annotated_vehicles(seen.detections)
    assert tracked is not None
    assert len(tracked) == len(seen.detections)


def test_a_car_park_of_meva_has_its_true_camera(tmp_path: Path, shared_data: Path) -> None:
    data = shared_data / "meva"
    published = read_calibration(data / "cameras" / "G506.krtd")
    with tarfile.open(data / "annotations.tar.xz") as packed:
        names = sorted(n for n in packed.getnames() if n.endswith("G506.geom.yml"))[:3]
        wanted = {n.replace(".geom.", f".{k}.") for n in names for k in ("geom", "types")}
        members = [m for m in packed.getmembers() if m.name in wanted]
        packed.extractall(tmp_path, members, filter="data")
    parts: list[Detections] = []
    for number, name in enumerate(names):
        found, _ = noted_annotations(tmp_path / name, published.image_size, 30.0, drop_invalid=True)
        found = found.select((found.class_name == "vehicle") & (found.frame % 5 == 0))
        later = 20_000 * number
        parts.append(replace(found, frame=found.frame + later, track=found.track + later))
    seen = Detections.concatenate(parts)
    camera = published.camera
    assert camera is not None
    options = replace(PEOPLE_ONLY, lens=camera.lens)
    answer = solve_segments(
        NOBODY, published.image_size, options, vehicles=annotated_vehicles(seen)
    )
    assert answer.camera is not None, answer.reason
    assert answer.camera.tilt_rad == pytest.approx(camera.tilt_rad, abs=np.radians(1.5))
    # The ground lies 0.5 to 1.5 m above the published frame's zero.
    assert camera.height_m - 2.2 < answer.camera.height_m < camera.height_m + 0.8
