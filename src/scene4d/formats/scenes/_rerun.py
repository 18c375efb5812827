"""Rerun (.rrd): the camera, and where everybody is on the ground and in the picture, on one clock.

    world/camera            where it stands, and its pinhole (without distortion)
    world/camera/boxes/N    track N in the picture, in pixels of the footage
    world/tracks/N          its foot point, with class and number
    world/tracks/N/error    the ground on which it is with a probability of 95 %, without what the
                            camera's error adds for all alike
    world/tracks/N/cuboid   length, width and height, where they are known
    world/paths/N           the whole way

The clock is ``time``: UTC where the start of the footage is known, and else seconds of the clip.
Metres; Z is up. It needs the Rerun SDK, which writes the file.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._pieces import in_frame_order, main_class, track_rows

_CHI_95 = 2.4477
"""Standard deviations of an ellipse that holds 95 %: the root of chi squared, two degrees."""
_FLAT_M = 0.01
_GONE_S = 0.5
"""So long after its last row somebody is no longer shown."""


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    rr = _sdk()
    recording = rr.RecordingStream("scene4d")
    stream = recording.binary_stream()
    for number, piece in enumerate(in_frame_order(pieces)):
        if number == 0:
            _say_camera(rr, recording, piece)
        tracks = piece.tracks.select(np.lexsort((piece.tracks.time_s, piece.tracks.track)))
        tracks = tracks.select(np.isfinite(tracks.xy_m).all(axis=1))
        for rows in track_rows(tracks) if len(tracks) else ():
            _say_track(rr, recording, piece, tracks.select(rows), number)
        yield ".rrd", stream.read() or b""


def _sdk() -> Any:
    try:
        import rerun
    except ModuleNotFoundError as error:
        raise UnavailableError(
            "rerun files are written by the Rerun SDK, which is not installed; "
            "pip install 'scene4d[rerun]'"
        ) from error
    return rerun


def _say_camera(rr: Any, recording: Any, piece: SceneTable) -> None:
    camera = piece.calibrated
    if camera is None:
        raise InputError("rerun: shows the tracks of a camera; export a scene")
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    pose = rr.Transform3D(translation=camera.centre_m, mat3x3=camera.R.T)
    lens = rr.Pinhole(
        image_from_camera=camera.K, resolution=piece.image_size, camera_xyz=rr.ViewCoordinates.RDF
    )
    recording.log("world/camera", pose, lens, static=True)


def _say_track(rr: Any, recording: Any, piece: SceneTable, rows: Tracks, number: int) -> None:
    track, name = int(rows.track[0]), main_class(rows)
    place, here = f"world/tracks/{track}", f"world/camera/boxes/{track}"
    xyz = np.column_stack([rows.xy_m, np.nan_to_num(rows.z_m)])  # 0: the ground that all share

    def send(entity: str, which: np.ndarray, columns: Any) -> None:
        if which.any():
            recording.send_columns(entity, [_clock(rr, piece, rows.time_s[which])], columns)

    every, boxed = np.ones(len(rows), bool), np.isfinite(rows.box_xyxy).all(axis=1)
    labels = [f"{name} {track}"] * len(rows)
    send(place, every, rr.Points3D.columns(positions=xyz, labels=labels))
    box = rows.box_xyxy[boxed]
    middle, half = (box[:, :2] + box[:, 2:]) / 2, (box[:, 2:] - box[:, :2]) / 2
    send(here, boxed, rr.Boxes2D.columns(centers=middle, half_sizes=half))
    known = np.isfinite(rows.covariance_m2).all(axis=(1, 2))
    size, turn = _ellipses(rows.covariance_m2[known])
    ellipses = rr.Ellipsoids3D.columns(centers=xyz[known], half_sizes=size, quaternions=turn)
    send(f"{place}/error", known, ellipses)
    solid = np.isfinite(rows.size_m).all(axis=1) & np.isfinite(rows.heading_rad)
    up = np.column_stack([np.zeros((len(rows), 2)), rows.size_m[:, 2] / 2])
    cuboids = rr.Boxes3D.columns(
        centers=(xyz + up)[solid],
        half_sizes=rows.size_m[solid] / 2,
        quaternions=_about_z(rows.heading_rad[solid]),
    )
    send(f"{place}/cuboid", solid, cuboids)
    recording.log(f"world/paths/{track}/{number}", rr.LineStrips3D([xyz]), static=True)
    gone = [_clock(rr, piece, rows.time_s[-1:] + _GONE_S)]
    for entity in (place, here):
        recording.send_columns(entity, gone, rr.Clear.columns(is_recursive=[True]))


def _clock(rr: Any, piece: SceneTable, time_s: np.ndarray) -> Any:
    if piece.start_utc is None:
        return rr.TimeColumn("time", duration=time_s)
    return rr.TimeColumn("time", timestamp=piece.start_utc.timestamp() + time_s)


def _ellipses(covariance_m2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half axes (m), flat on the ground, and how they are turned."""
    values, axes = np.linalg.eigh(covariance_m2)
    half = _CHI_95 * np.sqrt(np.maximum(values, 0))
    size = np.column_stack([half, np.full(len(half), _FLAT_M)])
    return size, _about_z(np.arctan2(axes[:, 1, 0], axes[:, 0, 0]))


def _about_z(angle_rad: np.ndarray) -> np.ndarray:
    """Quaternions x, y, z, w."""
    zero = np.zeros(len(angle_rad))
    return np.column_stack([zero, zero, np.sin(angle_rad / 2), np.cos(angle_rad / 2)])


FORMAT = SceneFormat(
    name="rerun",
    description="Rerun (.rrd): camera, tracks, boxes, cuboids and errors on one clock",
    suffixes=(".rrd",),
    write=_write,
)
