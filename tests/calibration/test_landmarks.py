"""Landmarks in the joint estimate: derivatives, coverage, mistakes, and real cameras."""

from dataclasses import dataclass, replace
from math import isclose

import numpy as np
import pytest

from calibration.scenes import draw_scene, errors_of, parameters_of, sigmas_of, solve_points
from scene4d.calibration import solve_camera, solve_segments
from scene4d.calibration._case import ImageFrame
from scene4d.calibration._landmarks import LandmarkTerm
from scene4d.calibration.calibrating import Run
from scene4d.calibration.options import POINTS, CalibrateOptions
from scene4d.calibration.report._page import report_files
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.landmarks import Distance, GroundPoint, Landmarks, Upright
from scene4d.core.people import Segments
from scene4d.formats.cameras import read_camera
from strategies import build_camera, build_lens
from type_checks import unchecked

FAR = 8.0
"""Ground points lie up to so many heights of the camera away."""
DOOR_M = 2.1


def ground(camera: Camera, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and positions of ``n`` places on the ground."""
    size = np.array(camera.image_size)
    uv = rng.uniform(0.03 * size, 0.97 * size, (4000, 2))
    xy_m, valid = camera.locate(uv)
    with np.errstate(invalid="ignore"):
        near = valid & (np.hypot(*xy_m.T) < FAR * camera.height_m)
    return uv[near][:n], xy_m[near][:n]


@dataclass
class Measured:
    """How well a scene is measured; ``noisy`` false: exactly."""

    camera: Camera
    rng: np.random.Generator
    sigma_m: float = 0.05
    sigma_px: float = 2.0
    noisy: bool = True

    def off(self, sigma: float, *shape: int) -> np.ndarray:
        return self.rng.normal(0, sigma if self.noisy else 0.0, shape)

    def clicked(self, uv: np.ndarray) -> list[tuple[float, float]]:
        seen = np.clip(
            uv + self.off(self.sigma_px, *uv.shape), 0, np.array(self.camera.image_size) - 1
        )
        return [(float(u), float(v)) for u, v in seen]

    def points(self, n: int) -> tuple[GroundPoint, ...]:
        """Points in a frame that is turned and far away."""
        _, xy_m = ground(self.camera, n, self.rng)
        assert len(xy_m) == n
        uv, _ = self.camera.project(np.column_stack([xy_m, self.off(self.sigma_m, n)]))
        angle, origin = self.rng.uniform(0, 2 * np.pi), self.rng.normal(0, 500, 2)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        own = (xy_m + self.off(self.sigma_m, n, 2)) @ turn + origin
        stated = {"sigma_m": self.sigma_m, "sigma_px": self.sigma_px}
        return tuple(
            GroundPoint(seen, (float(x), float(y)), **stated)
            for seen, (x, y) in zip(self.clicked(uv), own, strict=True)
        )

    def uprights(self, n: int) -> tuple[Upright, ...]:
        foot_uv, xy_m = ground(self.camera, n, self.rng)
        top_uv, _ = self.camera.project(np.column_stack([xy_m, DOOR_M + self.off(0.02, n)]))
        both = zip(self.clicked(foot_uv), self.clicked(top_uv), strict=True)
        return tuple(Upright(*ends, DOOR_M, sigma_px=self.sigma_px) for ends in both)

    def distances(self, n: int) -> tuple[Distance, ...]:
        uv, xy_m = ground(self.camera, 2 * n, self.rng)
        apart = np.hypot(*(xy_m[:n] - xy_m[n:]).T) + self.off(0.05, n)
        ends = zip(self.clicked(uv[:n]), self.clicked(uv[n:]), apart, strict=True)
        return tuple(Distance((a, b), float(d), sigma_px=self.sigma_px) for a, b, d in ends)


def nobody() -> Segments:
    return Segments.from_points(np.zeros((0, 2)), np.zeros((0, 2)))


LENS = build_lens((1920, 1080), 60)
CAMERA = build_camera(LENS, 25, 3, 6.0)


@pytest.fixture
def measured() -> Measured:
    return Measured(CAMERA, np.random.default_rng(4))


@pytest.fixture(scope="module")
def mistyped() -> Calibration:
    """A camera from seven points, the first of which is 3 m off, an upright and a distance."""
    measured = Measured(CAMERA, np.random.default_rng(4))
    first, *others = measured.points(7)
    x, y = first.xy_m
    wrong = replace(first, xy_m=(x + 3.0, y), name="<drain>")
    known = Landmarks((wrong, *others), measured.uprights(1), measured.distances(1))
    return unchecked_points(nobody(), (1920, 1080), landmarks=known)


def unchecked_points(*args: object, **options: object) -> Calibration:
    """Where many steps are taken; the other tests check the types of each."""
    with unchecked():
        return solve_points(*args, **options)


def all_kinds(measured: Measured) -> Landmarks:
    return Landmarks(measured.points(6), measured.uprights(2), measured.distances(2))


@pytest.mark.parametrize("fisheye", [False, True])
def test_derivatives_and_exact_residuals(measured, fisheye):
    """Residuals vanish at the true camera; derivatives are those of central differences."""
    term = LandmarkTerm.of(all_kinds(replace(measured, noisy=False)), ImageFrame((1920, 1080)))
    truth = parameters_of(measured.camera)
    frame = term.frame_at(truth)
    for residuals in term.of_kinds(truth, frame):
        assert np.abs(residuals.value).max() < 1e-9
    assert np.allclose(term.log_heights(truth[None, :3], 0.0), truth[3], atol=1e-9)
    term = term.with_fisheye() if fisheye else term
    z = np.concatenate([truth, frame]) + 0.01 * measured.rng.normal(size=10)
    z[4] = -0.03
    for kind, residuals in enumerate(term.of_kinds(z[:7], z[7:])):
        for column in range(6):
            step = np.zeros(10)
            step[column] = 1e-6
            there, here = (
                term.of_kinds((z + s)[:7], (z + s)[7:])[kind].value for s in (step, -step)
            )
            slope = (there - here) / 2e-6
            assert np.allclose(slope, residuals.by[:, :, column], rtol=1e-5, atol=1e-6)


def test_the_frame_is_eliminated(measured):
    """Gradient and second derivative are those of the cost at its best frame, near the answer."""
    landmarks = Landmarks(measured.points(4))
    term = LandmarkTerm.of(landmarks, ImageFrame((1920, 1080)))
    here = parameters_of(measured.camera) + 1e-3
    value = term.at(here)
    for column in range(7):
        step = np.zeros(7)
        step[column] = 1e-5
        ends = [term.at(here + s) for s in (step, -step)]
        slope = (ends[0].cost - ends[1].cost) / 4e-5
        assert isclose(slope, value.gradient[column], rel_tol=0.02, abs_tol=3.0)
        bend = (ends[0].gradient - ends[1].gradient)[column] / 2e-5
        assert isclose(bend, value.hessian[column, column], rel_tol=0.05, abs_tol=10.0)


WORLDS = {"nobody": (6, 0), "a few": (3, 10)}


@pytest.mark.parametrize(("n_points", "n_people"), WORLDS.values(), ids=WORLDS)
def test_known_noise_comes_out_as_stated(n_points, n_people):
    """(log f, tilt, roll, log height) over worlds: neither too sure nor too unsure."""
    z = []
    for seed in range(6):
        scene = draw_scene(seed, max(n_people, 3))
        rng = np.random.default_rng(1000 + seed)
        known = Landmarks(Measured(scene.camera, rng).points(n_points))
        people = scene.people
        seen = Segments.from_points(people.foot_uv[:n_people], people.head_uv[:n_people])
        found = unchecked_points(seen, scene.camera.image_size, landmarks=known)
        if found:
            z.append(errors_of(scene, found) / sigmas_of(found))
    assert len(z) >= 5
    rms = np.sqrt(np.mean(np.square(z)))
    inside = np.mean(np.abs(z) < 1.96)
    assert 0.6 < rms < 1.35 and inside > 0.87, (rms, inside)


def test_points_in_a_table_join_the_people(tmp_path):
    """Two of them, far apart, tell the scale better than people do."""
    scene = draw_scene(4, 60)
    uv, xy_m = ground(scene.camera, 40, np.random.default_rng(4))
    apart = np.linalg.norm(xy_m[:, None] - xy_m, axis=2)
    ends = list(np.unravel_index(apart.argmax(), apart.shape))
    uv, xy_m = uv[ends], xy_m[ends]
    table = tmp_path / "two.csv"
    rows = [f"{u},{v},{x},{y},0.02\n" for (u, v), (x, y) in zip(uv, xy_m, strict=True)]
    table.write_text("u,v,x_m,y_m,sigma_m\n" + "".join(rows))
    people = scene.people
    alone, joined = (
        solve_camera(
            people.foot_uv, people.head_uv, image_size=scene.camera.image_size,
            track=people.track, landmarks=landmarks,
        )
        for landmarks in (None, table)
    )  # fmt: skip
    assert joined.sigma["height_m"] < 0.9 * alone.sigma["height_m"]
    gap = abs(joined.camera.height_m - scene.camera.height_m)
    assert gap < 3 * joined.sigma["height_m"]


def test_the_scale_follows_the_points_against_the_people():
    """People of 1.35 m, believed to be 1.70 m; four points 2 cm right."""
    scene = draw_scene(3, 12, fov_deg=60, tilt_deg=25, mean_height_m=1.35, height_sigma=0.03)
    rng = np.random.default_rng(1)
    known = Landmarks(Measured(scene.camera, rng, sigma_m=0.02, sigma_px=1.0).points(4))
    people = Segments.from_points(scene.people.foot_uv, scene.people.head_uv, track=np.arange(12))
    options = {"population_sigma_m": 0.03, "lens": scene.camera.lens}
    alone = unchecked_points(people, scene.camera.image_size, **options)
    found = unchecked_points(people, scene.camera.image_size, landmarks=known, **options)
    assert abs(errors_of(scene, alone)[3]) > 0.2
    assert abs(errors_of(scene, found)[3]) < min(0.03, 3 * sigmas_of(found)[3])
    said = [text for text in found.warnings if "contradict the people: height" in text]
    assert len(said) == 1 and "people would be 1.3" in said[0]


def test_a_mistyped_point_is_named_and_left_out(mistyped):
    found = mistyped
    assert found and found.landmarks is not None
    assert found.landmarks.used.tolist() == [False] + [True] * 8
    assert isclose(found.landmarks.off_m[0], 3.0, abs_tol=0.5)
    assert any("The landmark <drain> is" in text for text in found.warnings)
    truth = parameters_of(CAMERA)[:4]
    assert found.camera is not None
    assert (np.abs(parameters_of(found.camera)[:4] - truth) < 4 * sigmas_of(found)).all()


def test_where_nobody_can_tell_which_is_wrong_all_count_less(measured):
    first, *others = measured.points(4)
    x, y = first.xy_m
    options = {"landmarks": Landmarks((replace(first, xy_m=(x + 5.0, y + 9.0)), *others))}
    found = unchecked_points(nobody(), (1920, 1080), lens=measured.camera.lens, **options)
    if found:
        assert any("miss one another by" in text for text in found.warnings)
    else:
        assert "landmarks" in str(found.reason)


def test_a_mirrored_frame_is_refused(measured):
    turned = tuple(replace(p, xy_m=p.xy_m[::-1]) for p in measured.points(5))
    with pytest.raises(InputError, match="mirror image"):
        solve_points(nobody(), (1920, 1080), landmarks=Landmarks(turned))


def test_the_fit_says_where_the_camera_stands(measured):
    """In the frame of the points; expected pixels are those of the true camera."""
    known = Landmarks(replace(measured, noisy=False).points(6))
    found = solve_points(nobody(), (1920, 1080), landmarks=known)
    fit = found.landmarks
    assert fit is not None and fit.camera_xy_m is not None and found.camera is not None
    uv = np.array([point.uv for point in known.points])
    assert np.abs(fit.expected_uv - uv).max() < 2.0
    xy_m, _ = measured.camera.locate(uv)
    apart = np.hypot(*(np.array([p.xy_m for p in known.points]) - fit.camera_xy_m).T)
    assert np.allclose(apart, np.hypot(*xy_m.T), rtol=0.05)


def test_one_or_two_landmarks_alone_are_refused_with_what_helps(measured):
    found = solve_points(nobody(), (1920, 1080), landmarks=Landmarks(measured.points(2)))
    assert not found
    assert "four or more ground points" in str(found.reason).rpartition("; ")[2]


def test_the_report_lists_and_draws_them(mistyped):
    files = report_files(Run(mistyped, "yard"))
    page = files["report.html"].decode()
    assert "&lt;drain&gt;" in page and "left out" in page and "upright 1" in page
    assert "the camera stands at" in page and "distance 1" in page
    assert len(files["figures/overlay.png"]) > 10_000


def test_a_real_lens_from_points_alone(shared_data):
    """Eight points of PETS 2009 by its published camera, whose lens is no model of ours."""
    truth = read_camera(shared_data / "pets2009" / "View_001.xml")
    rng = np.random.default_rng(0)
    uv = rng.uniform([60, 260], [700, 560], (8, 2))
    xy_m, valid = truth.locate(uv)
    assert valid.all()
    clicks = uv + rng.normal(0, 2.0, uv.shape)
    own = xy_m + rng.normal(0, 0.05, uv.shape)
    known = Landmarks(
        tuple(
            GroundPoint((float(u), float(v)), (float(x), float(y)))
            for (u, v), (x, y) in zip(clicks, own, strict=True)
        )
    )
    options = CalibrateOptions(orientation="people", landmarks=known)
    found = solve_segments(nobody(), truth.image_size, options)
    assert found and found.camera is not None
    grid = np.stack(np.meshgrid([150, 380, 600], [300, 400, 500]), axis=-1).reshape(-1, 2)
    here, there = (camera.locate(grid.astype(float))[0] for camera in (truth, found.camera))
    a, b = (p[:, 0] + 1j * p[:, 1] for p in (here, there))
    a, b = a - a.mean(), b - b.mean()
    turn = np.vdot(b, a)
    assert np.abs(b * turn / abs(turn) - a).mean() < 0.3
    assert abs(found.camera.height_m - truth.height_m) < 3 * found.sigma["height_m"]


def test_the_papers_method_takes_none():
    known = Landmarks(uprights=(Upright((1.0, 9.0), (1.0, 2.0), 2.0),))
    with pytest.raises(InputError, match=r"cannot use landmarks; use method \"joint\""):
        CalibrateOptions(method="paper", landmarks=known)


def test_boxes_alone_do_not_get_a_focal_length_from_two_points(measured):
    scene = draw_scene(5, 30)
    known = Landmarks(Measured(scene.camera, measured.rng).points(2))
    people = Segments.from_points(scene.people.foot_uv, scene.people.head_uv)
    boxes = replace(people, from_box=np.ones(len(people), bool))
    found: Calibration = solve_points(boxes, scene.camera.image_size, landmarks=known)
    assert not found and "boxes alone" in str(found.reason)


def test_options_read_the_file(tmp_path):
    bad = tmp_path / "l.json"
    bad.write_text('{"uprights": [{"foot_uv": [1, 90], "head_uv": [1, 2], "height_m": 2.0}]}')
    assert isinstance(replace(POINTS, landmarks=bad).read((100, 100)).landmarks, Landmarks)
    with pytest.raises(
        InputError, match=r"l\.json: uprights\[0\]: the pixel \(1, 90\) lies outside"
    ):
        replace(POINTS, landmarks=str(bad)).read((50, 50))
