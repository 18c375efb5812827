"""A small scene for the tests of exports, and the script that makes their golden files.

``python tests/formats/export_scenes.py`` writes tests/formats/golden_scenes/ anew; look at the
difference before you commit it.
"""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from made_tracks import made_tracks
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes import GeoAnchor, SceneTable, write_scene

GOLDEN = Path(__file__).parent / "golden_scenes"
START = datetime(2018, 3, 7, 17, 5, 1, tzinfo=UTC)
ANCHOR = GeoAnchor(39.0491, -85.5294, 0.5, 10.0, -20.0, 1.0, (0.1, 0.1))
SIZE = (1920, 1080)
ANKLES = ("left_ankle", "right_ankle")
GOLDEN_FILES = {
    "csv": "scene.csv",
    "mot": "scene.txt",
    "kpf": "scene",
    "geojson": "scene.geojson",
    "moving-features": "scene.json",
    "openlabel": "openlabel.json",
}


def tracks_of(track, frame, *, fps: float = 30.0, class_name="person", xy=None, **columns):
    """Rows with everything unknown but what is given; every row is seen, in a box of its own."""
    track, frame = np.asarray(track, np.int64), np.asarray(frame, np.int64)
    n = len(track)
    corner = np.column_stack([100.0 + 10 * track + frame, 50.0 + frame])
    values = {
        "covariance_m2": np.nan, "shared_covariance_m2": np.nan, "velocity_covariance": np.nan,
        "box_xyxy": np.hstack([corner, corner + np.array([20.25, 60.5])]),
        "heading_rad": np.nan, "frame": frame, "class_name": class_name,
    } | columns  # fmt: skip
    xy = np.full((n, 2), np.nan) if xy is None else np.asarray(xy, float).reshape(n, 2)
    return made_tracks(track, frame / fps, xy, **values)


def walker() -> Tracks:
    """A person who walks 1.2 m/s along +X; nobody saw the third moment."""
    n = 4
    walking = tracks_of(
        np.full(n, 1),
        np.arange(n) * 30,
        xy=np.column_stack([2.0 + 1.2 * np.arange(n), np.full(n, 8.0)]),
        covariance_m2=np.broadcast_to(np.diag([0.04, 0.09]), (n, 2, 2)).copy(),
        shared_covariance_m2=np.broadcast_to(np.diag([0.01, 0.02]), (n, 2, 2)).copy(),
        velocity_mps=np.tile([1.2, 0.0], (n, 1)),
        velocity_covariance=np.broadcast_to(np.eye(2) * 0.01, (n, 2, 2)).copy(),
        heading_rad=np.zeros(n),
        heading_sigma_rad=np.full(n, 0.1),
        z_m=np.zeros(n),
        z_sigma_m=np.zeros(n),
        size_m=np.tile([np.nan, np.nan, 1.75], (n, 1)),
        size_sigma_m=np.tile([np.nan, np.nan, 0.05], (n, 1)),
        keypoint_uv=np.arange(n * 4, dtype=float).reshape(n, 2, 2),
        keypoint_score=np.full((n, 2), 0.875),
        score=np.array([0.9, 0.8, np.nan, 0.7]),
        observed=np.array([True, True, False, True]),
    )
    walking.box_xyxy[2] = np.nan
    walking.keypoint_uv[2] = np.nan
    walking.keypoint_score[2] = np.nan
    return walking


def parked() -> Tracks:
    """A car that stands; one frame takes it for a truck."""
    return tracks_of(
        [2, 2, 2],
        [0, 30, 60],
        class_name=["car", "truck", "car"],
        xy=[[-5.0, 20.0], [-5.1, 20.1], [-4.9, 19.9]],
        covariance_m2=np.broadcast_to(np.eye(2) * 0.0625, (3, 2, 2)).copy(),
        shared_covariance_m2=np.zeros((3, 2, 2)),
        velocity_mps=np.zeros((3, 2)),
        heading_rad=np.full(3, 2.0),
        z_m=np.full(3, 0.25),
        z_sigma_m=np.full(3, 0.05),
        size_m=np.tile([4.4, 1.8, 1.5], (3, 1)),
        size_sigma_m=np.tile([0.4, 0.1, 0.125], (3, 1)),
        keypoint_uv=np.full((3, 2, 2), np.nan),
        keypoint_score=np.full((3, 2), np.nan),
    )


def nowhere() -> Tracks:
    """Somebody above the horizon, of a class with letters of its own."""
    return tracks_of(
        [7],
        [30],
        class_name="Fußgänger人",
        keypoint_uv=np.full((1, 2, 2), np.nan),
        keypoint_score=np.full((1, 2), np.nan),
        score=np.array([np.nan]),
    )


def scene(*parts: Tracks, **fields) -> SceneTable:
    """The three of them, of a camera on the Earth at a known time."""
    tracks = Tracks.concatenate(parts or (walker(), parked(), nowhere()))
    known = {"start_utc": START, "geo": ANCHOR}
    names = ANKLES[: tracks.keypoint_uv.shape[1]]
    return SceneTable(tracks, "G340", SIZE, **(known | {"keypoint_names": names} | fields))


def without_nowhere(**fields) -> SceneTable:
    return scene(walker(), parked(), **fields)


def moved(table: SceneTable, frames: int) -> SceneTable:
    """The same, so many frames later."""
    tracks = replace(
        table.tracks,
        frame=table.tracks.frame + frames,
        time_s=table.tracks.time_s + frames / 30.0,
    )
    return replace(table, tracks=tracks)


def write_golden(folder: Path) -> None:
    for name, file in GOLDEN_FILES.items():
        table = without_nowhere() if name == "moving-features" else scene()
        write_scene(table, folder / file, name)
    local = without_nowhere(geo=None, start_utc=None)
    write_scene(local, folder / "local.json", "moving-features")


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    write_golden(GOLDEN)
