"""What cannot be calibrated: the reason is said, and what would help."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import draw_scene, parameters_of, solve_points

from scene4d import solve_camera
from scene4d.calibration import CalibrateOptions, person_segments, solve_segments
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from scene4d.formats.demo import demo_detections
from strategies import build_camera, build_lens, people_scene
from type_checks import unchecked

SIZE = (1280, 720)
FOOT = np.array([[100.0, 300.0], [320.0, 400.0], [500.0, 450.0], [700.0, 600.0]])
HEAD = FOOT - [0.0, 120.0]


def seen(camera: Camera, xy_m: np.ndarray, seed: int, px: float = 0.7) -> tuple:
    """Feet and heads of people at ``xy_m``."""
    rng, n = np.random.default_rng([seed, 1]), len(xy_m)
    foot, _ = camera.project(np.column_stack([xy_m, np.full(n, 0.04)]))
    head, _ = camera.project(np.column_stack([xy_m, rng.normal(1.7, 0.09, n)]))
    length = np.hypot(*(foot - head).T)[:, None]
    head = head + 0.02 * length * rng.normal(size=(n, 2))
    return foot + px * rng.normal(size=(n, 2)), head + px * rng.normal(size=(n, 2))


def refused(foot, head, **kwargs) -> str:
    found = solve_camera(foot, head, image_size=SIZE, **kwargs)
    assert not found
    assert found.status == "undetermined"
    assert found.camera is None
    assert found.covariance is None
    assert found.ground_error_m is None
    assert found.segments is not None
    assert len(found.segments) == len(foot)
    return found.reason


@pytest.mark.parametrize("n", [0, 1, 2])
@pytest.mark.parametrize("method", ["joint", "paper"])
def test_nobody_or_too_few(n, method):
    told = Orientation(1000.0, 0.3, 0.0)
    reason = refused(FOOT[:n], HEAD[:n], method=method, prior=told)
    assert reason.startswith(f"{n} upright people are seen whole, and at least 3 are needed")
    assert "use more footage, or footage with people in it" in reason


def test_people_without_length_are_nobody():
    reason = refused(FOOT, FOOT.copy())
    assert reason.startswith("0 upright people are seen whole")


@pytest.mark.parametrize("seed", range(4))
def test_everybody_in_one_spot(seed):
    camera = build_camera(build_lens(SIZE, 45.0), 20.0, 0.0, 8.0)
    xy = np.random.default_rng(seed).normal([0.0, 22.0], 0.15, (20, 2))
    reason = refused(*seen(camera, xy, seed))
    assert "all people stand in one spot" in reason
    assert "people in other parts of the image, near and far" in reason
    assert "or a lens file (lens)" in reason
    assert "the focal length is not determined" in reason or "ground positions" in reason


@pytest.mark.parametrize("seed", range(4))
def test_everybody_at_one_distance(seed):
    camera = build_camera(build_lens(SIZE, 15.0), 6.0, 0.0, 8.0)
    rng = np.random.default_rng(seed)
    xy = np.column_stack([rng.uniform(-7, 7, 8), rng.normal(76.0, 0.3, 8)])
    reason = refused(*seen(camera, xy, seed))
    assert "all people are at one distance from the camera" in reason
    assert "people nearer to the camera and farther from it as well" in reason


@pytest.mark.parametrize("fov_deg", [45.0, 70.0])
def test_a_wide_row_at_one_distance_is_refused_or_right(fov_deg):
    """The feet's rows differ by their noise alone, and feet too low are people too long."""
    camera = build_camera(build_lens(SIZE, fov_deg), 8.0, 0.0, 8.0)
    rng = np.random.default_rng(0)
    half = 0.8 * 57 * np.tan(np.radians(fov_deg) / 2)
    xy = np.column_stack([rng.uniform(-half, half, 200), rng.normal(57.0, 0.1, 200)])
    foot, head = seen(camera, xy, 0, px=1.0)
    found = solve_camera(foot, head, image_size=SIZE)
    if found:
        z = (parameters_of(found.camera) - parameters_of(camera))[:4]
        assert (np.abs(z) < 4 * np.sqrt(np.diag(found.covariance))[:4]).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_single_file_along_the_view(seed):
    camera = build_camera(build_lens(SIZE, 45.0), 8.0, 0.0, 8.0)
    rng = np.random.default_rng(seed)
    xy = np.column_stack([rng.normal(0, 0.1, 20), rng.uniform(45, 80, 20)])
    reason = refused(*seen(camera, xy, seed))
    assert "the people are too few, or too similar in size and position" in reason
    assert "more people, near and far and on both sides" in reason


@pytest.mark.parametrize("seed", range(3))
def test_those_who_are_refused_are_determined_by_what_is_asked_for(seed):
    """The remedy works: the same single file with the focal length known."""
    camera = build_camera(build_lens(SIZE, 45.0), 8.0, 0.0, 8.0)
    rng = np.random.default_rng(seed)
    xy = np.column_stack([rng.normal(0, 0.1, 40), rng.uniform(30, 80, 40)])
    foot, head = seen(camera, xy, seed)
    assert "lens file" in refused(foot, head)
    found = solve_points(Segments.from_points(foot, head), image_size=SIZE, lens=camera.lens)
    assert found
    z = (parameters_of(found.camera) - parameters_of(camera))[1:4]
    z /= np.sqrt(np.diag(found.covariance))[1:4]
    assert (np.abs(z) < 4).all(), z
    told = solve_camera(
        foot,
        head,
        image_size=SIZE,
        prior=Orientation(camera.focal_px, 0.3, 0.0, 20.0, np.inf, np.inf),
    )
    assert told
    assert told.camera.focal_px == pytest.approx(camera.focal_px, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_sticks_that_are_no_people(seed):
    rng = np.random.default_rng(seed)
    foot = rng.uniform([0, 300], [1280, 700], (100, 2))
    head = foot - rng.uniform(20, 200, (100, 1)) * np.column_stack(
        [rng.normal(0, 0.6, 100), np.ones(100)]
    )
    reason = refused(foot, head)
    assert reason.startswith("only ")
    assert "% of the people agree with one camera over one flat ground" in reason
    assert "people who stand upright on the same plane" in reason


def test_people_on_their_heads():
    scene = draw_scene(3, 50, image_size=SIZE)
    reason = refused(scene.people.head_uv, scene.people.foot_uv)
    assert reason.startswith("most heads lie below the feet in the picture")
    assert "needed: footage turned by 180°" in reason


def test_boxes_alone():
    scene = draw_scene(3, 200, image_size=SIZE)
    boxes = Segments.from_points(scene.people.foot_uv, scene.people.head_uv, from_box=True)
    found = solve_points(boxes, image_size=SIZE)
    assert not found
    assert found.reason.startswith("boxes alone do not determine the focal length")
    for remedy in ("a lens file (lens)", "an orientation (orientation)", "keypoints"):
        assert remedy in found.reason
    # Half a focal length is none either; a good one will do, as will a lens.
    focal = scene.camera.focal_px
    vague = Orientation(focal, 0.3, 0.0, 0.5 * focal, np.inf, np.inf)
    assert "boxes alone" in solve_points(boxes, image_size=SIZE, orientation=vague).reason
    good = Orientation(focal, 0.3, 0.0, 0.1 * focal, np.inf, np.inf)
    for known in ({"orientation": good}, {"lens": scene.camera.lens}):
        found = solve_points(boxes, image_size=SIZE, **known)
        assert found or "boxes alone" not in found.reason
    # One person seen with its lean is no licence, but keypoints beside boxes are read.
    mixed = Segments.from_points(scene.people.foot_uv, scene.people.head_uv)
    assert solve_points(mixed, image_size=SIZE)


def test_boxes_of_whom_nobody_walks():
    """A box does not show who sits. Seen once, or with keypoints, people may stand still."""
    scene = draw_scene(1, 40, tracks=40, image_size=SIZE)
    track = np.repeat(np.arange(40), 2)
    ends = (np.repeat(uv, 2, axis=0) for uv in (scene.people.foot_uv, scene.people.head_uv))
    boxes = Segments.from_points(*ends, track=track, from_box=True)
    options = CalibrateOptions(lens=scene.camera.lens, orientation="people")
    found = solve_segments(boxes, SIZE, options)
    assert not found
    assert found.reason.startswith("nobody walks, and a box does not show")
    for others in (
        replace(boxes, from_box=np.zeros(80, bool)),
        replace(boxes, track=np.full(80, -1)),
        boxes.select(np.arange(80) % 2 == 0),
    ):
        answer = solve_segments(others, SIZE, options)
        assert answer or "nobody walks" not in answer.reason


def test_the_papers_method_where_nobody_agrees():
    told = Orientation(1000.0, 0.3, 0.0)
    reason = refused(HEAD, FOOT, method="paper", prior=told)
    assert reason.startswith("only 0 of")
    assert "agree with one camera height at this orientation" in reason
    assert 'method "joint"' in reason


def solved(scene):
    """Everybody is somebody else."""
    people = scene.people
    track = np.arange(len(people.foot_uv))
    return solve_camera(people.foot_uv, people.head_uv, image_size=SIZE, track=track)


def test_warnings_say_what_the_camera_rests_on():
    few = draw_scene(1, 6, image_size=SIZE)
    found = solved(few)
    assert found
    assert any("is based on 6 different people" in text for text in found.warnings)
    crowd = draw_scene(1, 300, image_size=SIZE)
    assert solved(crowd).warnings == ()
    strays = draw_scene(1, 300, image_size=SIZE, outliers=0.55)
    found = solved(strays)
    if found and found.inliers < 0.6 * 300:
        assert any("agree with the camera" in text for text in found.warnings)
    long = draw_scene(1, 12, fov_deg=18.0, tilt_deg=10.0, image_size=SIZE)
    found = solved(long)
    if found and found.sigma["focal_px"] > 0.15 * found.camera.focal_px:
        assert any("focal length is known to ±" in text for text in found.warnings)


def cut_out(seed: int) -> Segments:
    """The people of the PETS table, each frame cut out at a random place: no camera sees this."""
    people = person_segments(demo_detections())
    rng, (width, height) = np.random.default_rng(seed), demo_detections().image_size
    size = np.array([width, height]) / 2
    parts = []
    for frame in np.repeat(np.unique(people.frame), 3):
        corner, seen = rng.uniform(0, size), people.select(people.frame == frame)
        ends = [(uv - corner) * SIZE[0] / size[0] for uv in (seen.foot_uv, seen.head_uv)]
        inside = np.all([(uv > 0) & (uv < (1280, 960)) for uv in ends], axis=(0, 2))
        parts.append(replace(seen, foot_uv=ends[0], head_uv=ends[1]).select(inside))
    return Segments.joined(parts)


@pytest.mark.parametrize("seed", range(3))
def test_a_film_that_no_fixed_camera_took(seed):
    found = solve_segments(cut_out(seed), (1280, 960), CalibrateOptions(orientation="people"))
    assert not found
    assert "which is unlikely for a fixed camera" in found.reason
    assert "a lens file (lens)" in found.reason


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        (build_camera(build_lens(SIZE, 9.0), 12.0, 0.0, 25.0), "diagonal field of view of"),
        (
            build_camera(build_lens(SIZE, 30.0), 45.0, 0.0, 94.0),
            "m above the ground, which is unlikely",
        ),
    ],
    ids=["long lens", "high"],
)
def test_what_hardly_any_camera_is_must_be_told(camera, reason):
    people = people_scene(camera, 300, np.random.default_rng(0), noise=0.005, noise_px=0.1)
    points = {"foot_uv": people.foot_uv, "head_uv": people.head_uv, "image_size": SIZE}
    assert reason in (solve_camera(**points).reason or "")
    told = Orientation(camera.focal_px, camera.tilt_rad, 0.0, 5.0, np.inf, np.inf)
    found = solve_camera(**points, prior=told)
    assert found, found.reason
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=0.1)


# --- what is no input at all ---


@pytest.mark.parametrize("name", ["foot_uv", "head_uv"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_no_numbers_are_named_by_row(name, bad):
    points = {"foot_uv": FOOT.copy(), "head_uv": HEAD.copy()}
    points[name][2, 1] = bad
    points[name][3, 0] = bad
    with pytest.raises(InputError, match=f"{name} row 2 is not finite: drop people without that"):
        solve_camera(points["foot_uv"], points["head_uv"], image_size=SIZE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"head_uv": HEAD[:3]}, "must have one row per person"),
        ({"track": np.arange(3)}, "must have one row per person"),
        ({"foot_uv": FOOT.T}, r"foot_uv must be an \(n, 2\) array, found shape \(2, 4\)"),
        ({"head_uv": HEAD[:, :1]}, r"head_uv must be an \(n, 2\) array, found shape \(4, 1\)"),
        ({"foot_uv": FOOT[0]}, r"foot_uv must be an \(n, 2\) array, found shape \(2,\)"),
        ({"head_uv": np.c_[HEAD, HEAD]}, r"found shape \(4, 4\)"),
    ],
)
def test_wrong_shapes_are_named(arguments, message):
    """Without run-time checks of types, as users have it."""
    points = {"foot_uv": FOOT, "head_uv": HEAD, "image_size": SIZE}
    with unchecked(), pytest.raises(InputError, match=message):
        solve_camera(**(points | arguments))


def test_lists_will_do():
    scene = draw_scene(3, 20, image_size=SIZE)
    foot, head = scene.people.foot_uv, scene.people.head_uv
    with unchecked():
        listed = solve_camera(foot.tolist(), head.tolist(), image_size=SIZE)
    found = solve_camera(foot, head, image_size=SIZE)
    np.testing.assert_allclose(listed.camera.P, found.camera.P, rtol=1e-9)


@pytest.mark.parametrize("height", [0.0, 0.49, 2.51, -1.7, 170.0, np.nan, np.inf])
@pytest.mark.parametrize("method", ["joint", "paper"])
def test_a_mean_height_must_be_that_of_people(height, method):
    with pytest.raises(InputError, match=r"person_height_m must lie in 0\.5 to 2\.5 metres, found"):
        solve_camera(FOOT, HEAD, image_size=SIZE, person_height_m=float(height), method=method)


@pytest.mark.parametrize("height", [-0.01, 0.85, 1.0, np.nan])
def test_feet_must_be_low(height):
    with pytest.raises(InputError, match="foot_height_m must lie in 0 to half a person, found"):
        solve_camera(FOOT, HEAD, image_size=SIZE, foot_height_m=float(height))


def test_an_unknown_method():
    with pytest.raises(
        InputError, match=r"method must be one of \('joint', 'paper'\), found 'dlt'"
    ):
        solve_camera(FOOT, HEAD, image_size=SIZE, method="dlt")


def test_the_papers_method_needs_an_orientation():
    with pytest.raises(InputError, match="orientation"):
        solve_camera(FOOT, HEAD, image_size=SIZE, method="paper")
