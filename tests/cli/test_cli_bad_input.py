"""Bad input, end to end: exit 1, one line that says what is wrong, and nothing is written."""

import json
import resource
from pathlib import Path

import cv2
import numpy as np
import pytest

from cli_scenes import save_images


def assert_refused(done, out: Path, *words: str) -> None:
    """One line on stderr with these words, no output, and no folder left behind."""
    code = getattr(done, "exit_code", getattr(done, "returncode", None))
    assert code == 1, (done.stdout, done.stderr)
    assert done.stdout == ""
    told = [line for line in done.stderr.splitlines() if not line.endswith(" ...")]
    assert len(told) == 1 and told[0].startswith("scene4d: error: "), done.stderr
    for word in words:
        assert word in told[0]
    assert not out.exists()


def test_a_file_that_is_not_there(run, tmp_path):
    done = run("calibrate", tmp_path / "nope.mp4", "--out", tmp_path / "o" / "deep")
    assert_refused(done, tmp_path / "o", "nope.mp4", "No such file")


def test_a_zero_byte_file(run, tmp_path):
    (tmp_path / "empty.mp4").touch()
    done = run("calibrate", tmp_path / "empty.mp4", "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "empty.mp4", "0 bytes")


def test_a_corrupt_video(run, tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, 50_000, dtype=np.uint8)
    (tmp_path / "noise.mp4").write_bytes(noise.tobytes())
    done = run("calibrate", tmp_path / "noise.mp4", "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "noise.mp4", "is not a video")


def test_a_folder_that_was_there_stays(run, tmp_path):
    out = tmp_path / "o"
    out.mkdir()
    assert run("calibrate", tmp_path / "nope.mp4", "--out", out).exit_code == 1
    assert out.is_dir() and not list(out.iterdir())


@pytest.mark.weights
def test_footage_without_people(run, networks, tmp_path, plain_report):
    video = tmp_path / "blank.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"MJPG"), 5, (320, 240))
    for i in range(6):
        writer.write(np.full((240, 320, 3), 100 + i, np.uint8))
    writer.release()
    done = run("calibrate", video, "--out", tmp_path / "o", "--json")
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert found["status"] == "undetermined" and found["people"] == 0 and found["frames"] == 6
    assert "0 upright people" in found["reason"] and "P" not in found
    assert (tmp_path / "o" / "report.html").exists()


@pytest.mark.weights
def test_a_single_image_is_warned_of_or_refused(run, networks, pets_images, tmp_path, plain_report):
    """Nobody walks in one image: a camera of it must own how little it knows."""
    folder = save_images(tmp_path / "one", pets_images[:1])
    done = run("calibrate", folder / "0.jpg", "--out", tmp_path / "o", "--json")
    found = json.loads(done.stdout)
    assert found["frames"] == 1 and found["people"] < 15
    assert done.exit_code == (0 if found["status"] == "ok" else 1)
    assert found["status"] != "ok" or found["warnings"]


@pytest.mark.weights
def test_a_moving_camera(run, networks, pets_images, tmp_path):
    moved = [np.roll(image, 30 * i, axis=1) for i, image in enumerate(pets_images)]
    done = run("calibrate", save_images(tmp_path / "pan", moved), "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "pan", "the camera moves", "frames")


@pytest.mark.weights
def test_frames_of_changing_size(run, networks, pets_images, tmp_path):
    images = [*pets_images[:2], cv2.resize(pets_images[2], (640, 480))]
    done = run("calibrate", save_images(tmp_path / "sizes", images), "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "2.jpg", "640x480", "768x576")


@pytest.mark.weights
def test_a_truncated_video_is_used_as_far_as_it_goes(run, networks, pets, tmp_path, plain_report):
    cut = tmp_path / "cut.avi"
    cut.write_bytes(pets.read_bytes()[:4_000_000])
    told = ["--frames", 8, "--vehicles", "never", "--json"]
    done = run("calibrate", cut, *told, "--out", tmp_path / "o")
    found = json.loads(done.stdout)
    assert found["people"] >= 10 and found["frames"] == 8
    assert any("cut short" in w and "of 795 frames" in w for w in found["warnings"])


def test_footage_and_image_size_that_disagree(run, tmp_path):
    folder = save_images(tmp_path / "f", [np.zeros((48, 64, 3), np.uint8)])
    done = run("calibrate", folder, "--image-size", "640x480", "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "image_size", "64x48")


BAD_BOXES = {
    "3,-1,nan,300,60,200,1,-1,-1,-1": "nan",
    "3,-1,500,300,0,200,1,-1,-1,-1": "empty",
    "3,-1,500,300,60,-200,1,-1,-1,-1": "swapped",
    "3,-1,1500,300,60,200,1,-1,-1,-1": "outside",
    "3,-1,abc,300,60,200,1,-1,-1,-1": "abc",
    "3,-1,500": "columns",
}


@pytest.mark.parametrize("line", BAD_BOXES)
def test_impossible_boxes_are_refused_with_file_and_line(run, known, scene, tmp_path, line):
    lines = scene["boxes"].read_text().splitlines()
    scene["boxes"].write_text("\n".join([*lines[:2], line, *lines[2:]]))
    done = run(*known, "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "boxes.txt", "line 3", BAD_BOXES[line])


def test_impossible_boxes_can_be_left_out(run, known, scene, tmp_path, plain_report):
    with scene["boxes"].open("a") as file:
        file.write("9,-1,nan,300,60,200,1,-1,-1,-1\n9,-1,500,300,0,200,1,-1,-1,-1\n")
    done = run(*known, "--drop-invalid", "--out", tmp_path / "o", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["people"] == 60
    assert any("2 of 62 boxes" in warning for warning in found["warnings"])


def test_people_in_one_spot(run, known, scene, tmp_path, plain_report):
    rows = [f"{i},-1,{600 + i % 3},300,60,{200 + i % 5},1" for i in range(1, 40)]
    scene["boxes"].write_text("\n".join(rows))
    out = tmp_path / "o"
    done = run(*known[:-2], "--out", out)  # no lens
    assert done.exit_code == 1
    assert "undetermined" in done.stderr and "needed" in done.stderr
    assert json.loads((out / "camera.json").read_text())["status"] == "undetermined"


def test_a_lens_for_another_shape_of_image(run, known, camera, scene, tmp_path):
    values = camera.to_dict() | {"image_size": [640, 480]}
    scene["lens"].write_text(json.dumps(values))
    done = run(*known, "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "lens.json", "640x480", "1280x720")


def test_an_orientation_file_with_a_typo(run, known, tmp_path):
    wrong = tmp_path / "orientation.json"
    wrong.write_text('{"focal_px": 1000, "tilt_deg": 10, "rol_deg": 0}')
    done = run(*known, "--orientation", wrong, "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", "orientation.json", "rol_deg")


def test_a_weight_whose_hash_differs(run, pets, tmp_path, monkeypatch):
    from scene4d.perception.weights import WEIGHTS

    (tmp_path / "weights").mkdir()
    for weight in WEIGHTS:
        (tmp_path / "weights" / weight.file).write_bytes(b"another network")
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path))
    done = run("calibrate", pets, "--frames", 2, "--out", tmp_path / "o")
    assert_refused(done, tmp_path / "o", WEIGHTS[0].file, "SHA-256", "delete it")


def test_an_output_folder_that_cannot_be_made(run, known, tmp_path):
    (tmp_path / "file").touch()
    done = run(*known, "--out", tmp_path / "file" / "o")
    assert_refused(done, tmp_path / "file" / "o", "cannot be written")


def test_a_full_disk_leaves_the_earlier_result_as_it_was(run, spawn, known, tmp_path):
    """A limit on the size of files stands in for the full disk: writes fail in the same place."""
    out = tmp_path / "o"
    assert run(*known, "--out", out).exit_code == 0
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}

    page = (out / "report.html").stat().st_size
    figure = max(p.stat().st_size for p in (out / "figures").iterdir())
    assert figure < page, "the figures are to fit, and the page is not"

    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, ((figure + page) // 2, (figure + page) // 2))

    arguments = [*known, "--person-height", "1.8", "--out", out]
    # Python would keep modules cut off at that size, and every later test would read them.
    done = spawn(arguments, preexec_fn=small_files, env={"PYTHONDONTWRITEBYTECODE": "1"})
    assert done.returncode == 1
    told = [line for line in done.stderr.splitlines() if not line.endswith(" ...")]
    assert len(told) == 1 and "report.html: cannot be written: File too large" in told[0]
    assert f"{out}/" in told[0] and ".scene4d-" not in told[0]
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
    assert {p.name for p in out.iterdir()} == {p.relative_to(out).parts[0] for p in before}


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["calibrate"], "--out"),
        (["calibrate", "--out", "o"], "SOURCE"),
        (["calibrate", "--annotations", "a.txt", "--out", "o"], "--image-size"),
        (["calibrate", "v.mp4", "--out", "o", "--image-size", "1280"], "1920x1080"),
        (["calibrate", "v.mp4", "--out", "o", "--image-size", "0x720"], "--image-size"),
        (["calibrate", "v.mp4", "--out", "o", "--person-height", "170"], "metres"),
        (["calibrate", "v.mp4", "--out", "o", "--person-height", "nan"], "metres"),
        (["calibrate", "v.mp4", "--out", "o", "--method", "magic"], "--method"),
        (
            ["calibrate", "v.mp4", "--out", "o", "--method", "paper", "--orientation", "people"],
            "--orientation",
        ),
        (["calibrate", "v.mp4", "--out", "o", "--frames", "0"], "--frames"),
        (["calibrate", "v.mp4", "--out", "o", "--seed", "-1"], "--seed"),
        (["calibrate", "v.mp4", "--out", "o", "--sed", "1"], "--seed"),
        (["export", "c.json", "--out", "o"], "--to"),
        (["models", "fetsch"], "fetch"),
        (["calibrat", "v.mp4"], "calibrate"),
    ],
)
def test_wrong_usage(run, arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert done.exit_code == 2
    assert done.stdout == "" and word in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
