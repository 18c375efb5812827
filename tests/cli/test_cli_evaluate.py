"""``scene4d evaluate`` through the program: real recordings, any camera, and bad input."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from cli_scenes import SIZE
from scene4d.core.camera import Camera

HEIGHTS = "scene4d.evaluation.trials._cameras.HEIGHTS_M"


@pytest.fixture
def files(tmp_path: Path, camera: Camera) -> dict[str, Path]:
    """A calibration a little off, the true camera, and the true ground as a homography."""
    wrong = camera.disturbed(np.array([0.0, 0.0, 0.0, np.log(1.05), 0.0]))
    paths = {name: tmp_path / name for name in ("camera.json", "true.json", "img2world.txt")}
    wrong.save(paths["camera.json"])
    camera.save(paths["true.json"])
    np.savetxt(paths["img2world.txt"], np.linalg.inv(camera.P[:, [0, 1, 3]]))
    return paths


def scored(run, *arguments: object) -> dict:
    result = run("evaluate", "custom", *arguments, "--json")
    assert result.exit_code == 0, result.stderr
    (row,) = json.loads(result.stdout)["rows"]
    return row


def test_a_camera_against_itself(run, files):
    row = scored(run, "--camera", files["true.json"], "--reference", files["true.json"])
    assert row["correspondence_error_m"]["mean"] == pytest.approx(0, abs=1e-9)
    assert row["near"]["auc"] == 1.0


@pytest.mark.parametrize("reference", ["true.json", "img2world.txt"])
def test_a_camera_hung_too_high_stretches_its_map(run, files, camera, tmp_path, reference):
    uv = camera.project(np.array([[0, 10, 0], [0, 20, 0], [4, 12, 0], [-4, 18, 0.0]]))[0]
    points = tmp_path / "points.csv"
    points.write_text("u,v\n" + "".join(f"{u},{v}\n" for u, v in uv))
    row = scored(
        run,
        "--camera", files["camera.json"], "--reference", files[reference], "--points", points,
    )  # fmt: skip
    # 5 % too high makes the ground 5 % too large: after alignment that is left of the distances
    # from the middle of the points.
    xy = np.array([[0, 10], [0, 20], [4, 12], [-4, 18.0]])
    expected = 0.05 * np.hypot(*(xy - xy.mean(axis=0)).T)
    assert row["correspondence_error_m"]["mean"] == pytest.approx(expected.mean(), rel=1e-6)
    assert row["correspondence_error_m"]["sd"] == pytest.approx(expected.std(), rel=1e-6)


def test_the_files_of_an_evaluation(run, files, tmp_path):
    out = tmp_path / "deep" / "out"
    result = run(
        "evaluate", "custom", "--camera", files["camera.json"],
        "--reference", files["img2world.txt"], "--out", out,
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    assert "evaluation.html" in result.stdout
    assert json.loads((out / "evaluation.json").read_text())["dataset"] == "custom"
    page = (out / "evaluation.html").read_text()
    assert "<html" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    pictures = list((out / "figures").glob("*.png"))
    assert pictures
    assert not [p for p in out.iterdir() if p.name.startswith(".")]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"--camera": "missing.json"}, "missing.json"),
        ({"--reference": "half.txt"}, "half.txt"),
        ({"--points": "few.csv"}, "3 are needed"),
    ],
)
def test_bad_files_are_named(run, files, tmp_path, changed, message):
    (tmp_path / "half.txt").write_text("1 2 3 4 5\n")
    (tmp_path / "few.csv").write_text(f"{SIZE[0] / 2},{SIZE[1] - 20}\n")
    told = {"--camera": "camera.json", "--reference": "true.json"} | changed
    arguments = [str(x) for option, name in told.items() for x in (option, tmp_path / name)]
    out = tmp_path / "out"
    result = run("evaluate", "custom", *arguments, "--out", out)
    assert result.exit_code == 1
    assert message in result.stderr
    assert "internal error" not in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("given", [(), ("--camera", "camera.json", "--footage", "one.mp4")])
def test_a_camera_or_footage_but_not_both(run, files, given):
    result = run("evaluate", "custom", *given, "--reference", files["true.json"])
    assert result.exit_code == 2
    assert "give either a camera or footage" in result.stderr


def test_a_folder_without_the_data(run, tmp_path):
    for name in ("pets", "towncentre", "virat"):
        result = run("evaluate", name, "--data", tmp_path)
        assert result.exit_code == 1
        assert str(tmp_path) in result.stderr
        assert "internal error" not in result.stderr
        result = run("evaluate", name, "--data", tmp_path / "nowhere")
        assert result.exit_code == 1
        assert "internal error" not in result.stderr


def rows_of(result) -> list[dict]:
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)["rows"]


def pick(rows: list[dict], footage: str, method: str, given: str) -> dict:
    (row,) = [
        r for r in rows if (r["footage"], r["method"], r["given"]) == (footage, method, given)
    ]
    return row


@pytest.fixture
def one_height(monkeypatch) -> None:
    """The default height instead of all four (test_evaluating tries several)."""
    monkeypatch.setattr(HEIGHTS, (1.70,))


def thinned(path: Path, folder: Path, every: int) -> None:
    """Every so manieth line of a file of boxes: it says the same in less time."""
    lines = path.read_text().splitlines(keepends=True)
    (folder / path.name).write_text("".join(lines[::every]))


@pytest.mark.weights
@pytest.mark.usefixtures("networks", "one_height")
def test_pets_as_promised(run, shared_data, pets_images, tmp_path):
    data, out = tmp_path / "data", tmp_path / "pets"
    data.mkdir()
    (data / "View_001.xml").symlink_to(shared_data / "pets2009" / "View_001.xml")
    drawn = (shared_data / "pets2009" / "PETS2009-S2L1.xml").read_text()
    frames = re.compile(r"<frame number=.*?</frame>\s*", re.DOTALL)
    fifth = frames.sub(lambda one: one[0] if int(one[0].split('"')[1]) % 5 == 0 else "", drawn)
    (data / "PETS2009-S2L1.xml").write_text(fifth)
    video = cv2.VideoWriter(
        str(data / "few.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 1.0, pets_images[0].shape[1::-1]
    )
    for image in pets_images:
        video.write(image)
    video.release()
    result = run("evaluate", "pets", "--data", data, "--out", out, "--json")
    rows = rows_of(result)
    assert (out / "evaluation.html").exists()
    # Eight pictures tell less than the whole video, and say so (test_targets takes more of it).
    joint = pick(rows, "video, keypoints", "joint", "nothing")["correspondence_error_m"]
    assert joint["rms"] < 3 * joint["predicted_rms"]
    # What the network reads in them serves lines of mere boxes as well.
    lent = pick(rows, "hand-drawn boxes", "joint", "network")
    assert lent["status"] == "ok" or "focal length" in lent["reason"], lent
    notes = " ".join(json.loads(result.stdout)["notes"])
    assert "Faster R-CNN boxes were left out" in notes and "same camera" in notes
    lens = pick(rows, "hand-drawn boxes", "joint", "lens")
    assert lens["correspondence_error_m"]["mean"] < 0.4
    paper = pick(rows, "hand-drawn boxes", "paper", "true f, tilt, roll")
    assert paper["correspondence_error_m"]["mean"] < 0.4
    assert paper["near"]["auc"] > 0.98
    alone = pick(rows, "hand-drawn boxes", "joint", "nothing")
    assert alone["status"] == "refused"
    assert "focal length" in alone["reason"]
    assert not any(row["circular"] for row in rows)
    # A focal length as short as the paper's network saw it must hurt.
    for share in ("0.85", "0.70"):
        short = pick(rows, "hand-drawn boxes", "paper", f"{share} f, tilt, roll")
        assert short["correspondence_error_m"]["mean"] > paper["correspondence_error_m"]["mean"]


@pytest.mark.weights
@pytest.mark.usefixtures("networks", "one_height")
def test_towncentre_beats_the_paper_and_marks_what_is_circular(run, shared_data, tmp_path):
    full = shared_data / "towncentre"
    for name in ("TownCentre-calibration.ci", "tracker_boxes.txt", "frames"):
        (tmp_path / name).symlink_to(full / name)
    thinned(full / "TownCentreGTHalfRes.csv", tmp_path, 60)
    found = run("evaluate", "towncentre", "--data", tmp_path, "--json")
    rows = rows_of(found)
    published = json.loads(found.stdout)["published"]
    assert published["correspondence_error_m"]["mean"] == 1.18
    joint = pick(rows, "2 frames, keypoints", "joint", "nothing")
    assert joint["correspondence_error_m"]["mean"] < 0.5 * 1.18
    assert (
        joint["correspondence_error_m"]["rms"]
        < 3 * (joint["correspondence_error_m"]["predicted_rms"])
    )
    paper = pick(rows, "tracker boxes", "paper", "true f, tilt, roll")
    assert paper["correspondence_error_m"]["mean"] < 0.3
    assert {row["footage"] for row in rows if row["circular"]} == {"published boxes"}


def test_the_table_for_people(run, files):
    result = run(
        "evaluate", "custom", "--camera", files["camera.json"], "--reference", files["true.json"]
    )
    assert result.exit_code == 0
    assert "correspondence error" in result.stdout
    assert "camera.json" in result.stdout
