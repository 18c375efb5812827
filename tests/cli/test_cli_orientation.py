"""``scene4d orientation``, and ``calibrate`` with the network: through the program, with a network
that knows the answer."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cli_scenes import SIZE, save_images
from scene4d.core.camera import Camera
from scene4d.core.orientation import Orientation
from scene4d.perception.orientation import Belief, PoseReader

SIGMA = {"tilt_deg": 3.0, "roll_deg": 1.5, "log_vfov": 0.1}


def belief_of(camera: Camera, tilt_deg: float = 0.0) -> Belief:
    """16:9: the 4:3 crop has the picture's height, and so its field of view."""
    vfov = 2 * np.arctan(camera.image_size[1] / 2 / camera.focal_px)
    mean = camera.roll_rad, camera.tilt_rad + np.radians(tilt_deg), np.log(vfov)
    spread = np.radians(SIGMA["roll_deg"]), np.radians(SIGMA["tilt_deg"]), SIGMA["log_vfov"]
    return Belief.gaussian(tuple(map(float, mean)), tuple(map(float, spread)))


@pytest.fixture
def network(monkeypatch):
    def use(belief: Belief) -> None:
        monkeypatch.setattr(PoseReader, "belief", lambda self, image_bgr: belief)

    return use


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.integers(0, 255, (36, 64, 3)).astype(np.uint8), SIZE)
    return save_images(tmp_path / "pictures", [scene] * 12)


def test_the_json_object_is_what_is_promised(run, network, pictures, camera):
    network(belief_of(camera))
    result = run("orientation", pictures, "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert list(found)[4:] == ["focal_px", "tilt_deg", "roll_deg", "vfov_deg", "sigma", "frames"]
    assert set(found["sigma"]) == {"focal_px", "tilt_deg", "roll_deg", "vfov_deg"}
    assert found["focal_px"] == pytest.approx(camera.focal_px, rel=0.02)
    assert found["tilt_deg"] == pytest.approx(np.degrees(camera.tilt_rad), abs=0.1)
    assert found["frames"] == 12
    assert run("orientation", pictures / "0.jpg", "--json").exit_code == 0


def test_the_folder_and_its_use_for_calibrate(
    run, network, pictures, known, camera, tmp_path, plain_report
):
    network(belief_of(camera))
    out = tmp_path / "deep" / "out"
    result = run("orientation", pictures, "--frames", 3, "--out", out)
    assert result.exit_code == 0, result.stderr
    assert {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()} == {
        "orientation.json", "figures/orientation.png",
    }  # fmt: skip
    for once in ("Focal length", "Tilt", "Roll", "95 % interval", str(out / "orientation.json")):
        assert result.stdout.count(once) == 1, once
    assert "3 pictures" in result.stdout and "Warning" not in result.stdout
    told = Orientation.load(out / "orientation.json")
    assert told.focal_px == pytest.approx(camera.focal_px, rel=0.02)
    done = run(*known, "--orientation", out / "orientation.json", "--out", tmp_path / "c", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["height_m"] == pytest.approx(camera.height_m, rel=0.1)


def test_what_the_picture_does_not_tell_is_said_in_words(run, network, pictures, scene):
    network(Belief.even())
    everything = run("orientation", pictures)
    assert "do not determine the orientation" in everything.stdout
    some = run("orientation", pictures, "--lens", scene["lens"])
    assert "do not determine the roll or the tilt." in some.stdout
    assert "1100 px (given)" in some.stdout


def test_bad_input(run, network, pictures, camera, tmp_path):
    network(belief_of(camera))
    out = tmp_path / "out"
    missing = run("orientation", tmp_path / "none.mp4", "--out", out)
    assert missing.exit_code == 1 and "none.mp4" in missing.stderr and not out.exists()
    assert run("orientation").exit_code == 2
    for frames in (0, 1001):
        assert run("orientation", pictures, "--frames", frames).exit_code == 2
    lens = tmp_path / "square.json"
    Camera.from_pose(
        image_size=(500, 500), focal_px=400.0, tilt_rad=0.3, roll_rad=0.0, height_m=5.0
    ).save(lens)
    wrong = run("orientation", pictures, "--lens", lens, "--out", out)
    assert wrong.exit_code == 1 and "aspect ratio" in wrong.stderr and not out.exists()


def test_a_tiny_picture_is_refused_by_the_true_network(run, tmp_path):
    cv2.imwrite(str(tmp_path / "tiny.png"), np.zeros((20, 30, 3), np.uint8))
    done = run("orientation", tmp_path / "tiny.png")
    assert done.exit_code == 1 and "too small" in done.stderr
    assert "internal error" not in done.stderr


@pytest.fixture
def footage(pictures, scene, camera) -> list[object]:
    """Arguments of a calibration of pictures with boxes: no detector is needed."""
    return ["calibrate", pictures, "--annotations", scene["boxes"]]


def test_the_papers_method_from_end_to_end(run, network, footage, camera, tmp_path, plain_report):
    network(belief_of(camera))
    arguments = [*footage, "--method", "paper", "--orientation", "network"]
    done = run(*arguments, "--out", tmp_path / "o", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["method"] == "paper"
    assert found["height_m"] == pytest.approx(camera.height_m, rel=0.25)
    roll, tilt = np.degrees([camera.roll_rad, camera.tilt_rad])
    assert found["tilt_deg"] == pytest.approx(tilt, abs=1e-6)
    assert found["roll_deg"] == pytest.approx(roll, abs=1e-6)
    again = run(*footage, "--method", "paper", "--out", tmp_path / "a", "--json")
    assert json.loads(again.stdout)["tilt_deg"] == found["tilt_deg"], "auto means the network here"
    people = run(*footage, "--method", "paper", "--orientation", "people", "--out", tmp_path / "p")
    assert people.exit_code == 2 and "use network" in people.stderr


def test_boxes_become_a_camera_by_the_networks_guess(run, network, footage, camera, tmp_path):
    network(belief_of(camera))
    out = tmp_path / "o"
    done = run(*footage, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["height_m"] == pytest.approx(camera.height_m, rel=0.3)
    (warning,) = [text for text in found["warnings"] if "orientation network" in text]
    assert "a guess" in warning
    page = (out / "report.html").read_text()
    assert "a guess" in page and "second opinion" in page
    alone = run(*footage, "--orientation", "people", "--out", tmp_path / "p", "--json")
    assert alone.exit_code == 1 and "boxes alone" in json.loads(alone.stdout)["reason"]


def test_a_wrong_guess_is_dropped_and_both_numbers_are_said(
    run, network, footage, scene, camera, tmp_path, plain_report
):
    network(belief_of(camera, tilt_deg=30.0))
    found = {}
    for word in ("auto", "people"):
        arguments = [*footage, "--lens", scene["lens"], "--orientation", word]
        done = run(*arguments, "--out", tmp_path / word, "--json")
        assert done.exit_code == 0, done.stderr
        found[word] = json.loads(done.stdout)
    assert found["auto"]["P"] == found["people"]["P"]
    (warning,) = [text for text in found["auto"]["warnings"] if "network" in text]
    assert "left out" in warning and "tilt 47" in warning and "against 1" in warning
    assert not any("network" in text for text in found["people"]["warnings"])


def test_people_without_pictures_are_not_silently_alone(run, known, tmp_path, plain_report):
    done = run(*known, "--out", tmp_path / "o", "--json")
    assert any("no images" in text for text in json.loads(done.stdout)["warnings"])
    asked = run(*known, "--orientation", "network", "--out", tmp_path / "n")
    assert asked.exit_code == 1 and "needs pictures" in asked.stderr
