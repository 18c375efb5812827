"""``scene4d track`` through the program, and scenes through ``scene4d export``."""

import json
from pathlib import Path

import av
import numpy as np
import pytest
from typer.testing import CliRunner

from cli_scenes import mot_text, people
from scene4d.cli.app import app
from scene4d.evaluation import pets as pets_reference
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import write_camera
from scene4d.store.query import Scene
from scene4d.tracking._people import locate_people

FRAMES = 15


@pytest.fixture(scope="module")
def tracked(camera, tmp_path_factory) -> Path:
    """A scene of the boxes that the camera of these tests sees, without footage."""
    folder = tmp_path_factory.mktemp("tracked")
    out, boxes, lens = folder / "scene", folder / "boxes.txt", folder / "lens.json"
    boxes.write_text(mot_text(people(camera)))
    camera.save(lens)
    words = [
        "track", "--annotations", boxes, "--camera", lens, "--fps", 2, "--out", out,
        "--name", "yard", "--start", "2026-11-20T08:00:00+01:00", "--json",
    ]  # fmt: skip
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["camera"] == "yard" and told["rows"] == len(Scene.open(out))
    assert told["tracks"]["person"] == sum(told["tracks"].values())
    return out


def test_the_start_gives_every_row_its_moment(tracked):
    first = Scene.open(tracked).sql("SELECT min(time) AS t FROM scene")["t"].to_pylist()[0]
    assert str(first).startswith("2026-11-20 07:00:00")


@pytest.mark.parametrize("to", ["csv", "mot", "kpf", "moving-features", "openlabel"])
def test_a_scene_in_other_formats(run, tracked, tmp_path, to):
    out = tmp_path / f"tracks.{to}"
    result = run("export", tracked, "--to", to, "--out", out, "--json")
    assert result.exit_code == 0, result.stderr
    files = json.loads(result.stdout)["out"]
    assert files and all(Path(f).stat().st_size > 500 for f in files)
    if to == "mot":
        again = read_annotations(out, image_size=image_size_of(tracked))
        assert len(again) == len(Scene.open(tracked).tracks(observed=True))


def image_size_of(folder: Path) -> tuple[int, int]:
    values = json.loads(Scene.open(folder).camera_file("yard").read_text())
    return tuple(values["image_size"])


def test_a_scene_on_the_earth(run, tracked, tmp_path, camera):
    ground = np.array([[0.0, 10, 0], [0.0, 30, 0]])
    uv = camera.project(ground)[0]
    # 20 m to the north, on the ellipsoid.
    north = 53.0 + 20 / 111_300
    anchors = [f"{uv[0, 0]},{uv[0, 1]},53.0,8.0", f"{uv[1, 0]},{uv[1, 1]},{north},8.0"]
    out = tmp_path / "tracks.geojson"
    told = [x for a in anchors for x in ("--anchor", a)]
    result = run("export", tracked, "--to", "geojson", "--out", out, *told)
    assert result.exit_code == 0, result.stderr
    features = json.loads(out.read_text())["features"]
    assert len(features) == len(np.unique(Scene.open(tracked).tracks().track))
    alone = run("export", tracked, "--to", "geojson", "--out", out)
    assert alone.exit_code == 1 and "anchor of two or more ground points" in alone.stderr
    one = run("export", tracked, "--to", "geojson", "--out", out, *told[:2])
    assert one.exit_code == 1 and "two" in one.stderr.lower()
    wrong = run("export", tracked, "--to", "geojson", "--out", out, "--anchor", "1,2,3")
    assert wrong.exit_code == 2 and "u,v,lat,lon" in wrong.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--camera", "CAMERA"], 2, "give footage"),
        (["--camera", "missing.json", "--annotations", "BOXES"], 1, "missing.json"),
        (["--camera", "CAMERA", "--annotations", "BOXES"], 1, "fps"),
        (["--camera", "CAMERA", "no.avi"], 1, "no.avi"),
        (["--camera", "CAMERA", "no.avi", "--start", "noon"], 2, "is no time"),
        (["--camera", "CAMERA", "no.avi", "--rate", "0"], 2, "--rate"),
        (["--camera", "CAMERA", "no.avi", "--fps", "3"], 2, "--annotations"),
        (["--camera", "CAMERA", "no.avi", "--detector", "none"], 1, "no.avi"),
    ],
)
def test_bad_input_is_one_clear_line(run, scene, tmp_path, arguments, code, message):
    files = {"CAMERA": scene["lens"], "BOXES": scene["boxes"]}
    result = run("track", *(files.get(a, a) for a in arguments), "--out", tmp_path / "scene")
    assert result.exit_code == code, result.stderr
    assert message in result.stderr
    assert "internal error" not in result.stderr
    assert not list(tmp_path.glob("scene/**/*.parquet"))


@pytest.mark.weights
@pytest.mark.usefixtures("networks")
def test_real_footage_with_the_true_camera(spawn, pets, shared_data, tmp_path):
    """One and a half seconds of PETS: people within a few decimetres, and the parked van."""
    clip = tmp_path / "clip.mkv"
    with av.open(str(pets)) as source, av.open(str(clip), "w") as target:
        stream = target.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 768, 576, "bgr0"
        for number, frame in enumerate(source.decode(video=0)):
            if number == FRAMES:
                break
            picture = av.VideoFrame.from_ndarray(frame.to_ndarray(format="bgr24"), format="bgr24")
            target.mux(stream.encode(picture))
        target.mux(stream.encode(None))
    reference = pets_reference(shared_data / "pets2009")
    write_camera(reference.camera, tmp_path / "camera.json", "json")
    done = spawn(
        ["track", clip, "--camera", tmp_path / "camera.json", "--out", tmp_path / "s", "--json"]
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["tracks"]["person"] >= 4
    assert {"truck", "car"} & set(told["tracks"])
    tracks = Scene.open(tmp_path / "s").tracks(classes=["person"], observed=True)
    truth = read_annotations(shared_data / "pets2009" / "PETS2009-S2L1.xml", image_size=(768, 576))
    there = locate_people(truth, reference.camera).xy_m
    off = []
    for frame in range(FRAMES):
        seen = tracks.xy_m[tracks.frame == frame]
        true = there[truth.frame == frame]
        off += np.linalg.norm(true[:, None] - seen[None], axis=2).min(axis=1).tolist()
    assert np.median(off) < 0.3
    assert np.mean(np.array(off) < 1.5) > 0.85
