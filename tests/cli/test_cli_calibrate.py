"""The main command on real footage and on boxes, from end to end."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli_scenes import SIZE
from references import assert_good
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.tables import read_table
from scene4d.evaluation import pets as pets_reference

FILES = {"camera.json", "report.html", "people.parquet", "figures"}


@pytest.mark.weights
def test_real_footage(spawn, networks, pets, tmp_path):
    """PETS S2L1 in 24 frames, in a process of its own, against its published camera."""
    out = tmp_path / "new" / "folder"
    done = spawn(["calibrate", pets, "--frames", 24, "--out", out, "--json"])
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)  # one object and nothing else
    assert found["status"] == "ok" and found["image_size"] == [768, 576]
    assert found["frames"] == 24 and found["people"] >= found["inliers"] > 90
    assert_good(Calibration.load(out / "camera.json"), pets_reference(pets.parent), 1.0)
    assert_complete(out, found)
    assert_only_messages(done.stderr)


def assert_complete(out: Path, printed: dict[str, object]) -> None:
    """The folder holds what is promised and nothing else, and its parts agree."""
    assert {p.name for p in out.iterdir()} == FILES | {"background.jpg"}
    written = json.loads((out / "camera.json").read_text())
    envelope = {name: printed[name] for name in ("schema", "version", "warnings", "error")}
    assert printed == written | {"out": str(out)} | envelope
    people = read_table(out / "people.parquet")
    assert len(people["frame"]) == written["people"]
    assert int(people["inlier"].sum()) == written["inliers"]
    page = (out / "report.html").read_text()
    assert "vtest.avi" in page and "data:image" in page
    figures = {p.name for p in (out / "figures").iterdir()}
    assert figures == {"overlay.png", "birdseye.png", "errormap.png", "heights.png"}
    Camera.load(out / "camera.json")


def assert_only_messages(stderr: str) -> None:
    """Whole lines, each once, and no bars where there is no terminal."""
    lines = stderr.splitlines()
    assert all(line.startswith("scene4d: ") for line in lines), stderr
    assert "\x1b" not in stderr and "\r" not in stderr
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
    for once in (
        "Height",
        "Tilt",
        "Roll",
        "Focal length",
        "Error within",
        "Error from",
        "report.html",
    ):
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


def test_landmarks_set_the_scale(run, known, camera, tmp_path, plain_report):
    """Boxes of people with a wrong mean height, and five points of the true camera."""
    uv = [[200, 300], [900, 320], [640, 600], [300, 650], [1100, 680]]
    xy_m, valid = camera.locate(uv)
    assert valid.all()
    measured = tmp_path / "measured.json"
    points = [{"uv": a, "xy_m": b} for a, b in zip(uv, xy_m.tolist(), strict=True)]
    measured.write_text(json.dumps({"points": points}))
    arguments = [*known, "--person-height", "1.80", "--landmarks", measured, "--json"]
    done = run(*arguments, "--out", tmp_path / "o")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["height_m"] == pytest.approx(camera.height_m, rel=0.01)
    assert found["sigma"]["height_m"] < 0.02 * camera.height_m
    refused = run(*arguments, "--out", tmp_path / "p", "--method", "paper")
    assert refused.exit_code == 2 and "--landmarks" in refused.stderr
    measured.write_text('{"points": [{"uv": [1, 2]}]}')
    done = run(*arguments, "--out", tmp_path / "q")
    assert done.exit_code == 1 and "points[0].xy_m" in done.stderr + done.stdout


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


def test_every_option_reaches_the_room(run, tmp_path, monkeypatch):
    seen = []

    def remember(source, options, progress, *, command):
        assert command.startswith("scene4d")
        seen.append((source, options))
        raise InputError("enough")

    monkeypatch.setattr("scene4d.calibration.calibrating.run", remember)
    out = ("--out", tmp_path / "o")
    assert run("calibrate", "v.mp4", *out).exit_code == 1
    given = (
        "--lens l.json --annotations a.txt --image-size 640X480 --person-height 1.8 "
        "--method paper --orientation o.json --estimate-focal --frames 7 --seed 3 --drop-invalid"
    )
    assert run("calibrate", "rtsp://cam/1", *given.split(), *out).exit_code == 1
    assert seen[0] == ("v.mp4", CalibrateOptions())
    chosen = CalibrateOptions(
        lens=Path("l.json"),
        annotations=Path("a.txt"),
        image_size=(640, 480),
        person_height_m=1.8,
        method="paper",
        orientation="o.json",
        estimate_focal=True,
        frames=7,
        seed=3,
        drop_invalid=True,
    )
    assert seen[1] == ("rtsp://cam/1", chosen)


def test_an_undetermined_camera_is_written_with_its_reason(
    run, known, scene, tmp_path, plain_report
):
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
    printed = json.loads(as_json.stdout)
    assert printed["error"]["kind"] == "undetermined"
    assert found["reason"] in printed["error"]["message"]
    envelope = {name: printed[name] for name in ("schema", "version", "warnings", "error")}
    written = json.loads((out / "camera.json").read_text())
    assert printed == written | {"out": str(out)} | envelope


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


def test_the_format_of_annotations_can_be_named(run, known, scene, tmp_path, plain_report):
    right = run(*known, "--out", tmp_path / "a", "--format", "mot", "--json")
    assert json.loads(right.stdout)["status"] == "ok", right.stderr
    wrong = run(*known, "--out", tmp_path / "b", "--format", "kpf")
    assert wrong.exit_code == 1 and str(scene["boxes"]) in wrong.stderr
    unknown = run(*known, "--out", tmp_path / "b", "--format", "nope")
    assert unknown.exit_code == 1 and "mot" in unknown.stderr and "kpf" in unknown.stderr
    scene["boxes"].write_text("hello\n")
    unclear = run(*known, "--out", tmp_path / "b")
    assert unclear.exit_code == 1 and "give its format" in unclear.stderr
