"""The main command on real footage and on boxes, from end to end."""

import json

import numpy as np
import pytest
from cli_scenes import SIZE

from scene4d.formats.tables import read_table
from scene4d.model import Camera

FILES = {"camera.json", "report.html", "people.parquet", "figures"}


@pytest.fixture(scope="session")
def calibrated(spawn, networks, pets, tmp_path_factory):
    """PETS S2L1 in 30 frames: the finished process, and the folder that it wrote."""
    out = tmp_path_factory.mktemp("pets") / "new" / "folder"
    return spawn(["calibrate", pets, "--frames", 30, "--out", out, "--json"]), out


@pytest.fixture
def plain_report(monkeypatch):
    """Reports without figures, which take seconds, where they are not the matter."""
    monkeypatch.setattr("scene4d.report.page._draw", lambda *_: {})


@pytest.mark.weights
@pytest.mark.shared_data
def test_real_footage_gives_the_camera_as_published(calibrated):
    done, out = calibrated
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)  # one object and nothing else
    assert found["status"] == "ok" and found["image_size"] == [768, 576]
    assert found["height_m"] == pytest.approx(7.07, rel=0.15)
    assert found["tilt_deg"] == pytest.approx(16.48, abs=3)
    assert found["frames"] == 30 and found["people"] >= found["inliers"] > 100
    assert found["out"] == str(out)


@pytest.mark.weights
@pytest.mark.shared_data
def test_the_folder_holds_what_is_promised_and_nothing_else(calibrated):
    done, out = calibrated
    assert {p.name for p in out.iterdir()} == FILES
    printed, written = json.loads(done.stdout), json.loads((out / "camera.json").read_text())
    assert printed.pop("out") and printed == written
    people = read_table(out / "people.parquet")
    assert len(people["frame"]) == written["people"]
    assert int(people["inlier"].sum()) == written["inliers"]
    page = (out / "report.html").read_text()
    assert "vtest.avi" in page and "data:image" in page
    figures = {p.name for p in (out / "figures").iterdir()}
    assert figures == {"overlay.png", "birdseye.png", "errormap.png", "heights.png"}
    Camera.load(out / "camera.json")


@pytest.mark.weights
@pytest.mark.shared_data
def test_messages_go_to_stderr_line_by_line(calibrated):
    done, _ = calibrated
    lines = done.stderr.splitlines()
    assert all(line.startswith("scene4d: ") for line in lines), done.stderr
    assert "\x1b" not in done.stderr and "\r" not in done.stderr
    assert len(set(lines)) == len(lines)


def test_boxes_alone_with_a_lens(run, known, camera, tmp_path):
    result = run(*known, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["focal_px"] == camera.focal_px
    assert abs(found["height_m"] - camera.height_m) < 4 * found["sigma"]["height_m"]
    tilt = float(np.degrees(camera.tilt_rad))
    assert abs(found["tilt_deg"] - tilt) < 4 * found["sigma"]["tilt_deg"]
    # There is no picture: the report draws on a plain canvas.
    assert (tmp_path / "out" / "figures" / "overlay.png").stat().st_size > 10_000


def test_the_summary_says_everything_once(run, known, tmp_path, plain_report):
    out = tmp_path / "out"
    result = run(*known, "--out", out)
    assert result.exit_code == 0, result.stderr
    found = json.loads((out / "camera.json").read_text())
    for once in ("Height", "Tilt", "Roll", "Focal length", "Ground error", "report.html"):
        assert (result.stdout + result.stderr).count(once) == 1, once
    assert f"{found['tilt_deg']:.1f}° ±" in result.stdout and "±" in result.stdout
    assert f"{found['inliers']} " in result.stdout and "60 sightings" in result.stdout
    assert str(out / "report.html") in result.stdout, "a path must not be wrapped"
    assert all(line == line.rstrip() for line in result.stdout.splitlines())


def test_the_person_height_is_the_scale(run, known, tmp_path, plain_report):
    heights = []
    for tall in ("1.70", "1.87"):
        out = tmp_path / tall
        done = run(*known, "--person-height", tall, "--out", out, "--json")
        heights.append(json.loads(done.stdout)["height_m"])
    assert heights[1] / heights[0] == pytest.approx(1.1, rel=0.01)


def test_the_papers_method(run, known, scene, camera, tmp_path, plain_report):
    known_exactly = tmp_path / "orientation.json"
    tilt, roll = np.degrees([camera.tilt_rad, camera.roll_rad])
    values = {"focal_px": camera.focal_px, "tilt_deg": tilt, "roll_deg": roll}
    known_exactly.write_text(json.dumps(values))
    arguments = [*known, "--method", "paper", "--out", tmp_path / "o", "--json"]
    done = run(*arguments, "--orientation", known_exactly)
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["method"] == "paper"
    assert found["height_m"] == pytest.approx(camera.height_m, rel=0.05)


def test_a_lens_of_another_size_is_scaled(run, known, camera, tmp_path, plain_report):
    half = tmp_path / "half.json"
    lens = camera.scaled_to((SIZE[0] // 2, SIZE[1] // 2))
    Camera(**{**vars(camera), "image_size": lens.image_size, "K": lens.K}).save(half)
    done = run(*known, "--lens", half, "--out", tmp_path / "o", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["focal_px"] == pytest.approx(camera.focal_px)


def test_estimate_focal_does_not_take_it_from_the_lens(run, known, camera, tmp_path, plain_report):
    prior = tmp_path / "orientation.json"
    values = {"focal_px": 1000, "tilt_deg": 17, "roll_deg": 1}
    sigma = {"focal_px": 100, "tilt_deg": 3, "roll_deg": 2}
    prior.write_text(json.dumps(values | {"sigma": sigma}))
    arguments = [*known, "--orientation", prior, "--out", tmp_path / "o", "--json"]
    done = run(*arguments, "--estimate-focal")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["sigma"]["focal_px"] > 0


def test_an_undetermined_camera_is_written_with_its_reason(run, known, scene, tmp_path):
    scene["boxes"].write_text("1,-1,600,300,60,200,1\n2,-1,700,310,60,190,1\n")
    out = tmp_path / "out"
    done = run(*known, "--out", out)
    assert done.exit_code == 1
    found = json.loads((out / "camera.json").read_text())
    assert found["status"] == "undetermined" and "P" not in found
    assert "at least 3" in found["reason"]
    told = [line for line in done.stderr.splitlines() if "error" in line]
    assert told == [f"scene4d: error: the camera is undetermined: {found['reason']}"]
    assert str(out / "report.html") in done.stdout and found["reason"] not in done.stdout
    assert "at least 3" in (out / "report.html").read_text()
    as_json = run(*known, "--out", out, "--json")
    assert as_json.exit_code == 1
    assert json.loads(as_json.stdout) == found | {"out": str(out)}


def test_a_result_takes_the_place_of_an_earlier_one(run, known, scene, tmp_path):
    out = tmp_path / "out"
    assert run(*known, "--out", out).exit_code == 0
    mine = out / "notes.txt"
    mine.write_text("mine")
    scene["boxes"].write_text("1,-1,600,300,60,200,1\n")
    assert run(*known, "--out", out).exit_code == 1
    assert {p.name for p in out.iterdir()} == FILES | {"notes.txt"}
    assert [p.name for p in (out / "figures").iterdir()] == ["overlay.png"]


def test_passwords_do_not_come_into_the_report(monkeypatch):
    from scene4d.cli.calibrate import command_line

    monkeypatch.setattr(
        "sys.argv", ["scene4d", "calibrate", "rtsp://me:secret@cam/1", "--out", "a b"]
    )
    assert command_line() == "scene4d calibrate rtsp://cam/1 --out 'a b'"


def test_the_program_runs_without_a_home(spawn, known, tmp_path):
    """As in a service or a container: no HOME, an ASCII terminal."""
    lonely = {"HOME": "/nonexistent", "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    done = spawn([*known, "--out", tmp_path / "out"], env=lonely)
    assert done.returncode == 0, done.stderr
    assert "Height" in done.stdout and done.stdout.isascii()
