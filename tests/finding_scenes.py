"""A small scene on disk in which it is known what happens, and when.

Half a minute of one camera: somebody walks up to a parked car, bends into it and is gone, somebody
walks past far away from it, and two people come together and stay.
"""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from made_tracks import made_tracks
from scene4d.core.calibration import Calibration
from scene4d.core.tracks import Tracks
from scene4d.store.writing import SceneWriter
from walks import CAMERA, FPS, car_box, person_box, write_video

SECONDS = 30
CAR = (0.5, 16.0)
PERSON, PASSER, ONE, OTHER, PARKED = 1, 2, 3, 4, 9
ENTERED_S = 12.0
"""When the person is gone."""


def track(number: int, xy: np.ndarray, begin_s: float = 0.0, kind: str = "person") -> Tracks:
    """One object at every frame, with the box that the camera sees."""
    n = len(xy)
    time_s = begin_s + np.arange(n) / FPS
    velocity = np.gradient(xy, 1 / FPS, axis=0)
    box = person_box if kind == "person" else car_box
    return made_tracks(
        number, time_s, xy, class_name=kind, frame=np.rint(time_s * FPS).astype(int),
        velocity_mps=velocity, velocity_covariance=0.05**2, heading_sigma_rad=0.2,
        box_xyxy=np.array([box(place) for place in xy]),
    )  # fmt: skip


def walk(start, end, seconds: float) -> np.ndarray:
    """Straight from one place to the other."""
    share = np.linspace(0, 1, round(seconds * FPS))[:, None]
    return np.array(start) + share * (np.array(end, float) - start)


def stay(place, seconds: float) -> np.ndarray:
    return walk(place, place, seconds)


def bending(tracks: Tracks, seconds: float = 0.7, to: float = 0.6) -> Tracks:
    """The same who is seen less and less tall in the end."""
    box = tracks.box_xyxy.copy()
    left_s = tracks.time_s[-1] - tracks.time_s
    share = np.interp(left_s, [0, seconds], [to, 1.0])
    box[:, 1] = box[:, 3] - share * (box[:, 3] - box[:, 1])
    return replace(tracks, box_xyxy=box)


def people() -> list[Tracks]:
    """Everybody on foot."""
    return [
        bending(track(PERSON, walk((-4.5, 11.0), (0.2, 15.6), ENTERED_S - 7), begin_s=7.0)),
        track(PASSER, walk((-2.5, 8.5), (2.5, 8.5), 4), begin_s=2.0),
        track(ONE, np.vstack([walk((-5, 22), (-0.6, 26), 6), stay((-0.6, 26), 6)]), 16.0),
        track(OTHER, np.vstack([walk((6, 23), (0.4, 26), 6), stay((0.4, 26), 6)]), 16.0),
    ]


def parked() -> Tracks:
    return track(PARKED, stay(CAR, SECONDS), kind="car")


def write_scene(
    folder: Path,
    tracks: list[Tracks],
    *,
    camera: str = "gate",
    run: str = "morning",
    start: datetime | None = None,
    provenance: dict | None = None,
    watched_s: tuple[float, ...] = (),
) -> Path:
    """A run of these tracks; added to the scene if there is one. ``watched_s`` are moments that
    were looked at, where that is known.
    """
    rows = Tracks.concatenate(tracks)
    rows = rows.select(np.lexsort([rows.track, rows.time_s]))
    with SceneWriter(
        folder,
        camera=camera,
        run=run,
        start_utc=start,
        camera_json=Calibration.of_camera(CAMERA).to_dict(),
        provenance={} if provenance is None else provenance,
    ) as writer:
        writer.write(rows)
        moments = np.array(watched_s)
        writer.watched(moments, np.rint(moments * FPS).astype(int), gap_s=2.0)
    return folder


def write_footage(path: Path) -> Path:
    """Footage of the empty ground."""
    return write_video(path, seconds=SECONDS)
