"""``scene4d export``, for every format that is written."""

import json
from dataclasses import replace

import numpy as np
import pytest

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.formats.cameras import camera_formats, read_camera

WRITTEN = [f.name for f in camera_formats() if f.write is not None]


@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_exported_is_the_same_camera(run, scene, camera, tmp_path, name):
    out = tmp_path / "exported"
    done = run("export", scene["lens"], "--to", name, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["format"], found["out"]) == (name, [str(out)])
    found = read_camera(out, format=name, image_size=camera.image_size)
    np.testing.assert_allclose(found.K, camera.K, atol=1e-3)
    if isinstance(found, Camera):
        np.testing.assert_allclose(found.P, camera.P, atol=1e-2)


def test_it_says_what_it_wrote(run, scene, tmp_path):
    done = run("export", scene["lens"], "--to", "krtd", "--out", tmp_path / "a.krtd")
    assert done.stdout == f"Wrote {tmp_path / 'a.krtd'}: Kitware KRTD (MEVA)\n"


def test_a_camera_of_another_program_is_converted(run, scene, camera, tmp_path):
    krtd, back = tmp_path / "a.krtd", tmp_path / "back.json"
    run("export", scene["lens"], "--to", "krtd", "--out", krtd)
    assert run("export", krtd, "--to", "json", "--out", back).exit_code == 0
    np.testing.assert_allclose(Camera.load(back).P, camera.P, atol=1e-6)


@pytest.mark.parametrize(("focal", "height"), [("1100", "-5"), ("1e308", "0"), ("1e308", "5")])
def test_a_camera_that_could_not_be_read_back_is_not_written(run, tmp_path, focal, height):
    """R15: it was written, or an internal error."""
    krtd, back = tmp_path / "a.krtd", tmp_path / "back.json"
    krtd.write_text(
        f"{focal} 0 640\n0 {focal} 360\n0 0 1\n\n1 0 0\n0 0 -1\n0 1 0\n\n0 {height} 9\n\n0\n"
    )
    done = run("export", krtd, "--image-size", "1280x720", "--to", "json", "--out", back)
    assert done.exit_code == 1 and "a camera.json holds" in done.stderr
    assert not back.exists()


def test_a_calibration_keeps_its_covariance(run, scene, tmp_path):
    """W6."""
    out, covariance = tmp_path / "again.json", 1e-4 * np.eye(7)
    made = Calibration.of_camera(Camera.load(scene["lens"]))
    replace(made, method="joint", covariance=covariance).save(scene["lens"])
    assert run("export", scene["lens"], "--to", "json", "--out", out).exit_code == 0
    assert out.read_text() == scene["lens"].read_text()
    np.testing.assert_array_equal(Calibration.load(out).covariance, covariance)


@pytest.mark.parametrize("name", ["nope", "tsai", ""])
def test_a_format_that_is_not_written_is_wrong_usage(run, scene, tmp_path, name):
    done = run("export", scene["lens"], "--to", name, "--out", tmp_path / "x")
    assert done.exit_code == 2 and done.stdout == ""
    for known in WRITTEN:
        assert known in done.stderr
    assert not (tmp_path / "x").exists()


def test_a_lens_is_no_camera(run, scene, tmp_path):
    ros = tmp_path / "lens.yaml"
    run("export", scene["lens"], "--to", "ros", "--out", ros)
    done = run("export", ros, "--to", "json", "--out", tmp_path / "x")
    assert done.exit_code == 1 and "no pose" in done.stderr and str(ros) in done.stderr


def test_an_undetermined_camera_is_not_exported(run, scene, tmp_path):
    values = {"schema": "scene4d/camera/1", "status": "undetermined", "reason": "too few people"}
    scene["lens"].write_text(json.dumps(values))
    done = run("export", scene["lens"], "--to", "krtd", "--out", tmp_path / "x")
    assert done.exit_code == 1 and "too few people" in done.stderr
    assert not (tmp_path / "x").exists()


def test_a_folder_that_cannot_be_made(run, scene, tmp_path):
    (tmp_path / "no").write_text("a file")
    done = run("export", scene["lens"], "--to", "krtd", "--out", tmp_path / "no" / "x")
    assert done.exit_code == 1 and done.stdout == ""
    assert done.stderr.startswith("scene4d: error: ") and len(done.stderr.splitlines()) == 1


def test_a_folder_that_is_not_there_is_made(run, scene, tmp_path):
    done = run("export", scene["lens"], "--to", "krtd", "--out", tmp_path / "new" / "deep" / "x")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "new" / "deep" / "x").is_file()


def test_a_format_without_an_image_size_is_told_it(run, scene, camera, tmp_path):
    stream, back = tmp_path / "camInfo.yml", tmp_path / "back.json"
    run("export", scene["lens"], "--to", "deepstream", "--out", stream)
    older = stream.read_text().replace("projectionMatrix_3x4_w2p", "other")
    stream.write_text(older)  # the entry that counts from the image centre alone
    done = run("export", stream, "--to", "json", "--out", back)
    assert done.exit_code == 1 and "image_size" in done.stderr
    size = "{}x{}".format(*camera.image_size)
    done = run(
        "export",
        stream,
        "--to",
        "json",
        "--out",
        back,
        "--image-size",
        size,
        "--from",
        "deepstream",
    )
    assert done.exit_code == 0, done.stderr
    np.testing.assert_allclose(Camera.load(back).P, camera.P, atol=1e-2)


def test_the_camera_that_is_read_is_not_written_over(run, scene):
    before = scene["lens"].read_bytes()
    done = run("export", scene["lens"], "--to", "krtd", "--out", scene["lens"])
    assert done.exit_code == 1 and "give another --out" in done.stderr
    assert scene["lens"].read_bytes() == before


def test_a_calibration_exported_as_json_loses_nothing(run, known, tmp_path, plain_report):
    """Its covariance above all: without it, a reader would believe the camera exact."""
    assert run(*known, "--out", tmp_path / "out").exit_code == 0
    before, after = tmp_path / "out" / "camera.json", tmp_path / "new" / "deep" / "c.json"
    done = run("export", before, "--to", "json", "--out", after)
    assert done.exit_code == 0, done.stderr
    assert json.loads(after.read_text()) == json.loads(before.read_text())
    assert json.loads(after.read_text())["covariance"]


def test_a_name_cannot_steer_the_terminal(run, scene, tmp_path):
    out = tmp_path / "a\x1b[31m.krtd"
    done = run("export", scene["lens"], "--to", "krtd", "--out", out)
    assert done.exit_code == 0 and out.is_file()
    assert "\x1b" not in done.stdout and "a\\x1b[31m.krtd" in done.stdout
