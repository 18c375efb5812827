"""``scene4d evaluate meva`` through the program, on a tiny MEVA made here."""

import json
import shutil
import tarfile
from pathlib import Path

import numpy as np
import pytest

from scene4d.core.camera import Camera

CAMERAS = ("G328", "G341", "G424", "G506")
CAMERA = Camera.from_pose(
    image_size=(1920, 1080), focal_px=1400.0, tilt_rad=0.35, roll_rad=0.0, height_m=8.0,
    centre_uv=(960.0, 540.0),
)  # fmt: skip
FRAMES = 360
STOPS = 180


def car_box(x: float, y: float) -> np.ndarray:
    corners = [[x + dx, y + dy, z] for dx in (-2.2, 2.2) for dy in (-0.9, 0.9) for z in (0.1, 1.5)]
    uv = CAMERA.project(np.array(corners))[0]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def drives(frame: int) -> float:
    """Along the picture at 6 m/s until it brakes within 2 s, and stands."""
    left = max(0.0, (STOPS - frame) / 30)
    return 3.0 - (6.0 * (left - 1) if left > 2 else 1.5 * left**2)


def clip(folder: Path, camera: str) -> None:
    stem = folder / f"2018-03-05.13-10-00.13-11-00.school.{camera}"
    lines = []
    for frame in range(FRAMES):
        box = " ".join(f"{value:.0f}" for value in car_box(drives(frame), 22.0))
        lines.append(f"- {{'geom': {{'g0': '{box}', 'id1': 5, 'ts0': {frame}}}}}\n")
    stem.with_name(stem.name + ".geom.yml").write_text("".join(lines))
    stem.with_name(stem.name + ".types.yml").write_text(
        "- {'types': {'cset3': {'vehicle': 1.0}, 'id1': 5}}\n"
    )
    stem.with_name(stem.name + ".activities.yml").write_text(
        "- {'act': {'act2': {'vehicle_stops': 1.0}, 'actors': [{'id1': 5, 'timespan': [{'tsr0': "
        f"[{STOPS - 60}, {STOPS}]}}]}}], 'id2': 1, 'timespan': [{{'tsr0': [{STOPS - 60}, "
        f"{STOPS}]}}]}}}}\n"
    )


@pytest.fixture(scope="module")
def meva(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("meva")
    (data / "cameras").mkdir()
    (data / "annotations").mkdir()
    lines = [*CAMERA.K, [], *CAMERA.R, [], CAMERA.t, [], [0.0] * 5]
    text = "".join(" ".join(f"{value:.12g}" for value in line) + "\n" for line in lines)
    for camera in CAMERAS:
        (data / "cameras" / f"{camera}.krtd").write_text(text)
        clip(data / "annotations", camera)
    return data


def test_what_is_found_and_what_is_said(run, meva, tmp_path):
    out = tmp_path / "out"
    result = run("evaluate", "meva", "--data", meva, "--out", out, "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["cameras"] == {"tuned": ["G341", "G424"], "reported": ["G328", "G506"]}
    assert (found["clips"], found["minutes"]) == (2, 2.0)
    assert any("annotated, not detected" in note for note in found["notes"])
    assert any("Only actors of labelled activities" in note for note in found["notes"])
    rows = {row["activity"]: row for row in found["activities"]}
    stops = rows["vehicle_stops"]
    assert stops["labelled"] == 2
    assert stops["methods"]["metres"]["average_precision"] == 1.0
    assert stops["methods"]["metres"]["p_miss"]["0.02"] == 0.0
    assert stops["methods"]["near"]["average_precision"] is None
    assert stops["methods"]["pixels"]["metres_per_px"] > 0
    assert rows["person_enters_vehicle"]["labelled"] == 0
    page = (out / "evaluation.html").read_text()
    assert "vehicle stops" in page
    assert json.loads((out / "evaluation.json").read_text())["activities"] == found["activities"]
    assert (out / "figures" / "det.png").exists()


def test_the_table_for_people_from_the_archive(run, meva, tmp_path):
    packed = tmp_path / "packed"
    shutil.copytree(meva / "cameras", packed / "cameras")
    with tarfile.open(packed / "annotations.tar.xz", "w:xz") as archive:
        archive.add(meva / "annotations", "annotations")
    result = run("evaluate", "meva", "--data", packed)
    assert result.exit_code == 0, result.stderr
    assert "vehicle_stops" in result.stdout
    assert "person_enters_vehicle" not in result.stdout  # nobody is labelled so
    assert "G328 and G506" in result.stdout
    assert "annotated, not detected" in " ".join(result.stdout.split())


def test_another_camera_may_be_reported(run, meva, tmp_path):
    more = tmp_path / "more"
    shutil.copytree(meva, more)
    shutil.copy(more / "cameras" / "G506.krtd", more / "cameras" / "G419.krtd")
    clip(more / "annotations", "G419")
    result = run("evaluate", "meva", "--data", more, "--camera", "G419", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["cameras"]["reported"] == ["G419"]
    assert found["clips"] == 1
    for camera, said in (("G341", "constants were chosen on it"), ("G999", "G999.krtd")):
        result = run("evaluate", "meva", "--data", more, "--camera", camera)
        assert result.exit_code == 1
        assert said in result.stderr


@pytest.mark.parametrize(
    ("remove", "said"),
    [
        ("cameras/G506.krtd", "G506.krtd"),
        ("annotations", "annotations.tar.xz"),
        ("annotations/2018-03-05.13-10-00.13-11-00.school.G328.geom.yml", "camera G328"),
        ("annotations/2018-03-05.13-10-00.13-11-00.school.G328.activities.yml", "activities.yml"),
        ("annotations/2018-03-05.13-10-00.13-11-00.school.G341.types.yml", "types.yml"),
    ],
)
def test_what_is_missing_is_named(run, meva, tmp_path, remove, said):
    broken = tmp_path / "broken"
    shutil.copytree(meva, broken)
    gone = broken / remove
    shutil.rmtree(gone) if gone.is_dir() else gone.unlink()
    out = tmp_path / "out"
    result = run("evaluate", "meva", "--data", broken, "--out", out)
    assert result.exit_code == 1
    assert said in result.stderr
    assert str(broken) in result.stderr
    assert "internal error" not in result.stderr
    assert not out.exists()
