"""The picture of a run: a thinned copy of its paths, of bounded size, drawn at the end."""

from pathlib import Path

import numpy as np

from scene4d.calibration.writing import BACKGROUND
from scene4d.core.camera import Camera
from scene4d.core.files import write_bytes
from scene4d.core.tracks import Tracks

MOST_ROWS = 40_000
"""So many positions are drawn at most: beyond, every second one is forgotten."""


class Sketch:
    """Collects positions as they come."""

    def __init__(self) -> None:
        self._step = 1
        self._parts: list[list[np.ndarray]] = []  # track, class, time, position
        self._rows = 0

    def add(self, tracks: Tracks) -> None:
        """Rows with a position, thinned."""
        rows = np.flatnonzero(np.isfinite(tracks.xy_m[:, 0]) & (tracks.frame % self._step == 0))
        if not len(rows):
            return
        columns = (tracks.track, tracks.class_name, tracks.time_s, tracks.xy_m)
        self._parts.append([column[rows] for column in columns])
        self._rows += len(rows)
        if self._rows > MOST_ROWS:
            whole = [np.concatenate(c) for c in zip(*self._parts, strict=True)]
            while len(whole[0]) > MOST_ROWS:
                self._step *= 2
                whole = [c[::2] for c in whole]
            self._parts, self._rows = [whole], len(whole[0])

    def draw(self, path: Path, camera: Camera, camera_file: Path) -> bool:
        """Write the picture; false where nobody has a position.

        The background that ``calibrate`` keeps beside the camera file is used where it is there.
        """
        from scene4d.drawing.scene_map import draw_scene_map

        if not self._rows:
            return False
        track, name, time_s, xy = (np.concatenate(c) for c in zip(*self._parts, strict=True))
        order = np.lexsort([time_s, track])
        track, name, xy = track[order], name[order], xy[order]
        starts = np.flatnonzero(np.diff(track, prepend=-1))
        paths = {
            int(t): (str(n), part)
            for t, n, part in zip(
                track[starts], name[starts], np.split(xy, starts[1:]), strict=True
            )
        }
        from scene4d.tracking.watching import calibrated_view

        image = calibrated_view(camera_file.with_name(BACKGROUND), camera.image_size)
        content = draw_scene_map(camera, paths, image)
        if content is None:
            return False
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, content)
        return True
