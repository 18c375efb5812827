"""What the Rerun SDK is given; the file itself is read back by ``benchmarks/rerun_file.py``."""

import sys
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest
from export_scenes import scene, tracks_of

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError, UnavailableError
from scene4d.formats.scenes import write_scene

CAMERA = Camera.from_pose(
    image_size=(640, 480), focal_px=600.0, tilt_rad=0.35, roll_rad=0.1, height_m=5.0
)
START = datetime(2026, 11, 20, 8, tzinfo=UTC)


def said(**values):
    return values


@pytest.fixture
def given(monkeypatch) -> dict[str, list]:
    """By entity, what a stand-in for the SDK was given."""
    heard: dict[str, list] = {}

    class Stream:
        def binary_stream(self):
            return SimpleNamespace(read=lambda: b"rrd")

        def log(self, entity, *what, static):
            assert static
            heard.setdefault(entity, []).extend(what)

        def send_columns(self, entity, clock, columns):
            heard.setdefault(entity, []).append((clock[0], columns))

    kinds = ("Points3D", "Boxes2D", "Boxes3D", "Ellipsoids3D", "Clear")
    sdk = {name: SimpleNamespace(columns=said) for name in kinds}
    sdk |= {"Transform3D": said, "Pinhole": said, "LineStrips3D": lambda strips: strips}
    sdk |= {"TimeColumn": lambda name, **time: time, "RecordingStream": lambda name: Stream()}
    sdk["ViewCoordinates"] = SimpleNamespace(RIGHT_HAND_Z_UP="up", RDF="rdf")
    monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace(**sdk))
    return heard


def table(**more):
    tracks = tracks_of([7, 7, 8], [0, 10, 10], xy=np.array([[1.0, 9.0], [2, 9], [np.nan, 0]]))
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    own = turn @ np.diag([0.04, 0.01]) @ turn.T
    tracks = replace(
        tracks,
        time_s=np.array([0.0, 1.0, 1.0]),
        covariance_m2=np.broadcast_to(own, (3, 2, 2)).copy(),
        size_m=np.array([[4.0, 2.0, 1.5]] * 3),
        heading_rad=np.array([0.5, np.nan, 0.5]),
    )
    made = scene(tracks, geo=None, start_utc=START)
    return replace(made, **({"image_size": CAMERA.image_size, "calibrated": CAMERA} | more))


def test_everything_is_where_the_camera_sees_it(tmp_path, given):
    write_scene(table(), tmp_path / "a.rrd", "rerun")
    assert (tmp_path / "a.rrd").read_bytes() == b"rrd"
    pose, lens = given["world/camera"]
    (clock, points), (gone, clear) = given["world/tracks/7"]
    np.testing.assert_allclose(clock["timestamp"], START.timestamp() + np.array([0, 1]))
    np.testing.assert_allclose(gone["timestamp"], START.timestamp() + 1.5)
    assert clear == {"is_recursive": [True]}
    seen = (
        (points["positions"] - pose["translation"]) @ pose["mat3x3"] @ lens["image_from_camera"].T
    )
    np.testing.assert_allclose(
        seen[:, :2] / seen[:, 2:], CAMERA.project(points["positions"])[0], atol=1e-6
    )
    ((_, ellipses),) = given["world/tracks/7/error"]
    assert sorted(ellipses["half_sizes"][0][:2]) == pytest.approx([0.245, 0.490], abs=1e-3)
    longest = int(np.argmax(ellipses["half_sizes"][0][:2]))
    angle = 2 * np.arctan2(*ellipses["quaternions"][0][2:]) + longest * np.pi / 2
    assert np.tan(angle) == pytest.approx(0.75)
    ((when, cuboids),) = given["world/tracks/7/cuboid"]
    assert len(when["timestamp"]) == len(cuboids["centers"]) == 1, "one heading is unknown"
    assert cuboids["half_sizes"].tolist() == [[2.0, 1.0, 0.75]]
    assert cuboids["centers"][0] == pytest.approx([1, 9, 0.75])
    assert "world/tracks/8" not in given, "it is nowhere on the ground"


def test_without_a_start_the_clock_is_the_clips(tmp_path, given):
    write_scene(table(start_utc=None), tmp_path / "a.rrd", "rerun")
    np.testing.assert_allclose(given["world/tracks/7"][0][0]["duration"], [0, 1])


def test_without_camera_or_sdk_nothing_is_written(tmp_path, given, monkeypatch):
    with pytest.raises(InputError, match="the tracks of a camera"):
        write_scene(table(calibrated=None), tmp_path / "a.rrd", "rerun")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(UnavailableError, match=r"scene4d\[rerun\]"):
        write_scene(table(), tmp_path / "a.rrd", "rerun")
    assert not list(tmp_path.iterdir())
