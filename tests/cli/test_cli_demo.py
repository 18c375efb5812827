"""The demo, and the people that come with the package for machines without a network."""

import json
import shutil
from dataclasses import replace
from importlib import import_module
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from defusedxml import ElementTree

from scene4d.calibration import person_segments
from scene4d.cli.demo import PUBLISHED
from scene4d.core.errors import UnavailableError
from scene4d.formats.cameras import read_camera
from scene4d.formats.demo import FILE_NAME, IMAGE_SIZE, demo_columns, demo_detections
from scene4d.store.query import Scene
from scene4d.video import sample

demo = import_module("scene4d.cli.demo")


@pytest.fixture
def no_network(tmp_path, monkeypatch):
    """An empty cache, and no source that answers."""
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path / "cache"))

    def nothing(*_: object, **__: object) -> None:
        raise UnavailableError("the network is\nclosed")

    nowhere = replace(sample.SAMPLE, sources=())
    monkeypatch.setattr(sample, "SAMPLE", nowhere)
    monkeypatch.setattr("scene4d.perception.weights.fetch_all", nothing)
    return tmp_path / "cache"


def test_without_a_network_it_ends_with_camera_and_report_and_says_so(run, no_network, tmp_path):
    out = tmp_path / "out"
    done = run("demo", "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["status"] == "ok" and found["people_from"] == "embedded table"
    assert found["height_m"] == pytest.approx(7.07, rel=0.1)
    assert found["tilt_deg"] == pytest.approx(16.48, abs=2)
    assert any("sample video could not be downloaded" in w for w in found["warnings"])
    assert "vtest.avi" in done.stderr and "continuing with people" in done.stderr
    assert all(line.startswith("scene4d: ") for line in done.stderr.splitlines())
    assert "could not be downloaded" in (out / "report.html").read_text()
    assert (out / "figures" / "overlay.png").exists()


def test_with_the_video_but_no_networks_the_report_shows_the_scene(
    run, no_network, pets, tmp_path, monkeypatch
):
    (no_network / "samples").mkdir(parents=True)
    shutil.copy(pets, no_network / "samples" / "vtest.avi")
    shown = []
    monkeypatch.setattr(
        "scene4d.calibration.report._page._draw", lambda run, _: shown.append(run.image_bgr) or {}
    )
    done = run("demo", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert "networks could not be downloaded" in " ".join(done.stdout.split())
    assert "the network is closed" in done.stderr
    assert PUBLISHED in done.stdout and str(tmp_path / "out" / "report.html") in done.stdout
    assert shown[0].shape == (576, 768, 3)


@pytest.mark.weights
def test_the_whole_chain(run, networks, pets, tmp_path, monkeypatch, plain_report):
    """Calibrated from the embedded people, which is quick; the rest is as users see it."""

    def quickly(progress):
        return demo._from_embedded_people(pets, "in this test", progress), pets

    monkeypatch.setattr(demo, "_calibrated", quickly)
    monkeypatch.setattr(demo, "_TRACKED_S", 2.0)
    calibrate, told = import_module("scene4d.cli.calibrate"), {}
    answer = calibrate.calibrated
    monkeypatch.setattr(
        calibrate, "calibrated", lambda *a, **more: told.update(more) or answer(*a, **more)
    )
    out = tmp_path / "out"
    done = run("demo", "--out", out)
    assert done.exit_code == 0, done.stderr
    shown = [Path(line.strip()) for line in done.stdout.split("Open these pages:")[1].split()]
    pages = [path.name for path in shown if path.suffix == ".html"]
    assert pages == ["page.html", "report.html", "search.html"]
    assert all(path.is_file() for path in shown)
    assert told["people_from"] == "video"  # what --json says beside the camera
    assert told["search"]["events"], "somebody walks in the first two seconds"
    scene = Scene.open(told["scene"])
    people = scene.tracks(classes=["person"])
    assert len(np.unique(people.track)) >= 4 and np.ptp(people.time_s) == pytest.approx(2, abs=0.3)


@pytest.mark.weights
def test_a_damaged_network_is_no_reason_to_fall_back(run, tmp_path, pets, monkeypatch):
    from scene4d.perception.weights import WEIGHTS

    for name in ("samples", "weights"):
        (tmp_path / name).mkdir()
    shutil.copy(pets, tmp_path / "samples" / "vtest.avi")
    for weight in WEIGHTS:
        (tmp_path / "weights" / weight.file).write_bytes(b"damaged")
    monkeypatch.setenv("SCENE4D_CACHE", str(tmp_path))
    done = run("demo", "--out", tmp_path / "out")
    assert done.exit_code == 1 and "SHA-256" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.weights
def test_the_embedded_people_are_those_of_the_video(networks, pets):
    """A fifth of the table is made anew from the footage."""
    from types import SimpleNamespace

    from scene4d.perception.people import PeopleDetector, detect_people

    table = demo_detections()
    frames = np.unique(table.frame)[::20]
    video = cv2.VideoCapture(str(pets))
    images = {}
    for index in range(frames[-1] + 1):
        video.grab()
        if index in frames:
            images[index] = video.retrieve()[1]
    anew = detect_people(
        [SimpleNamespace(index=int(i), time_s=i / 10, image_bgr=images[i]) for i in frames],
        PeopleDetector.default(),
    )
    kept = table.select(np.isin(table.frame, frames))
    assert len(kept) == len(anew)
    np.testing.assert_array_equal(kept.frame, anew.frame)
    np.testing.assert_allclose(kept.box_xyxy, anew.box_xyxy, atol=0.5)
    here = [anew.keypoint_names.index(name) for name in kept.keypoint_names]
    sure = kept.keypoint_score > 0.5
    apart = np.hypot(*np.moveaxis(kept.keypoint_uv - anew.keypoint_uv[:, here], -1, 0))
    assert np.quantile(apart[sure], 0.99) < 1.0


def test_the_table_is_small_and_whole():
    resource = files("scene4d.formats") / "data" / FILE_NAME
    assert len(resource.read_bytes()) < 300_000
    people = demo_detections()
    assert people.image_size == IMAGE_SIZE
    assert len(np.unique(people.frame)) > 90 and len(np.unique(people.track)) >= 8
    assert (np.diff(people.frame) >= 0).all() and np.isfinite(people.keypoint_uv).all()
    np.testing.assert_allclose(people.time_s, people.frame / 10, atol=1e-5)
    assert len(person_segments(people)) > 400


def test_what_is_written_is_what_is_read():
    people = demo_detections()
    columns = demo_columns(people)
    np.testing.assert_allclose(columns["x1"], people.box_xyxy[:, 0], atol=0.051)
    np.testing.assert_allclose(columns["head_top_v"], people.keypoint_uv[:, 0, 1], atol=0.051)


def test_the_published_camera_is_that_of_its_file(shared_data):
    path = shared_data / "pets2009" / "View_001.xml"
    assert ElementTree.parse(path).getroot().tag == "Camera"
    camera = read_camera(path)
    tilt, roll = np.degrees([camera.tilt_rad, camera.roll_rad])
    assert f"height {camera.height_m:.2f} m, tilt {tilt:.2f}°, roll {roll:.2f}°" == PUBLISHED
