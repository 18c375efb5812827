"""The public names of ``scene4d``: all there, typed, light, and one chain."""

import inspect
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import supervision as sv

import scene4d
from cli_scenes import SIZE, mot_text, people
from scene4d import Camera

PROMISED = {
    *("Calibration", "Camera", "Lens", "Orientation", "Scene", "Site", "__version__"),
    *("align", "calibrate"),
    *("read_camera", "search", "solve_camera", "track", "watch", "write_camera"),
}


def test_the_public_names_are_those_that_are_promised():
    assert sorted(scene4d.__all__) == sorted(PROMISED)
    assert set(dir(scene4d)) >= PROMISED
    assert scene4d.__version__ == version("scene4d")
    for name in PROMISED - {"__version__"}:
        found = getattr(scene4d, name)
        assert inspect.getdoc(found), name
        for parameter in inspect.signature(found).parameters.values():
            assert parameter.annotation is not inspect.Parameter.empty, (name, parameter)
    with pytest.raises(AttributeError, match="nothing_like_it"):
        _ = scene4d.nothing_like_it


def test_type_checkers_see_the_same_names():
    text = Path(scene4d.__file__).read_text()
    seen = set(re.findall(r"^    from \S+ import (\w+) as \1$", text, re.MULTILINE))
    assert seen | {"__version__"} == PROMISED


def test_a_star_import_in_a_fresh_process_does_not_hide_functions_behind_rooms():
    """A package of a function's name would take its place once the package is imported."""
    program = (
        "import scene4d.searching._entry, scene4d.tracking._running, scene4d.calibration._solve\n"
        "from scene4d import *\n"
        "print(*(callable(one) for one in (calibrate, track, search, solve_camera)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == ["True"] * 4, done.stderr


@pytest.fixture
def camera() -> Camera:
    return Camera.from_pose(
        image_size=SIZE, focal_px=1100.0, tilt_rad=0.3, roll_rad=0.02, height_m=6.0
    )


def test_the_whole_chain_in_python(camera, tmp_path):
    """Boxes in a file; a calibration, a scene and a search out; options by their names."""
    boxes, lens, scene = tmp_path / "boxes.txt", tmp_path / "lens.json", tmp_path / "scene"
    boxes.write_text(mot_text(people(camera)))
    camera.save(lens)
    found = scene4d.calibrate(None, annotations=boxes, image_size=SIZE, lens=lens)
    assert found.camera.height_m == pytest.approx(6.0, rel=0.1)
    found.save(tmp_path / "camera.json")
    again = scene4d.Calibration.load(tmp_path / "camera.json")
    np.testing.assert_allclose(
        again.ground_sigma_m([[600, 500]]), found.ground_sigma_m([[600, 500]])
    )

    walk = [
        (i, *camera.project([[0.1 * i - 2, 15, 0], [0.1 * i - 2, 15, 1.7]])[0]) for i in range(60)
    ]
    boxes.write_text(
        "".join(
            f"{i + 1},1,{head[0] - 12:.2f},{head[1]:.2f},24,{foot[1] - head[1]:.2f},1,-1,-1,-1\n"
            for i, foot, head in walk
        )
    )
    run = scene4d.track(None, found, scene, annotations=boxes, fps=10.0)
    assert run.tracks == {"person": 1}
    tracks = scene4d.Scene.open(scene)
    frame = tracks.to_pandas(classes=["person"])
    assert np.hypot(frame["vx_mps"], frame["vy_mps"]).median() == pytest.approx(1.0, rel=0.15)
    result = scene4d.search(tracks, "a person walks for more than 2 seconds", min_score=0.1)
    assert len(result) == 1
    assert list(result.to_pandas()["activity"]) == [result.events[0].event.activity]


def test_a_drop_in_for_users_of_supervision(camera):
    """Boxes in; metres, speeds and sigma out."""
    foot_m = np.array([[-2.0, 14.0, 0.0], [1.0, 20.0, 0.0]])
    step_m = np.array([[0.12, 0.05, 0.0], [0.0, -0.1, 0.0]])

    def seen(at_m: np.ndarray) -> sv.Detections:
        foot, head = camera.project(at_m)[0], camera.project(at_m + np.array([0, 0, 1.7]))[0]
        xyxy = np.column_stack([foot[:, 0] - 10, head[:, 1], foot[:, 0] + 10, foot[:, 1]])
        return sv.Detections(xyxy=xyxy, tracker_id=np.array([1, 2]))

    found = scene4d.Calibration.of_camera(camera)
    before_m, _ = found.camera.locate(seen(foot_m))
    xy_m, on_ground = found.camera.locate(seen(foot_m + step_m))
    speed_mps = np.linalg.norm(xy_m - before_m, axis=1) / 0.1
    sigma_m = found.ground_sigma_m(seen(foot_m))

    assert on_ground.all()
    np.testing.assert_allclose(before_m, foot_m[:, :2], atol=1e-6)
    np.testing.assert_allclose(speed_mps, [1.3, 1.0], atol=1e-6)
    np.testing.assert_array_equal(sigma_m, 0.0)
