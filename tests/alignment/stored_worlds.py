"""Made sites as scenes on disk."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from alignment.worlds import Seen
from scene4d.core.tracks import Tracks
from scene4d.store.writing import SceneWriter


def scene_of(
    folder: Path,
    seen: Seen,
    *,
    tracks: Tracks | None = None,
    start: datetime | None = None,
    camera: str | None = None,
    run: str = "run",
) -> Path:
    """What a camera of a made site saw, as a scene; times begin at 0."""
    rows = seen.tracks if tracks is None else tracks
    rows = rows.select(np.lexsort((rows.track, rows.time_s)))
    track = np.unique(rows.track, return_inverse=True)[1]
    with SceneWriter(
        folder,
        camera=camera or seen.name,
        run=run,
        start_utc=start,
        camera_json=seen.calibration.to_dict(),
        provenance={"source": f"{seen.name}.mp4"},
    ) as writer:
        if len(rows):
            writer.write(replace(rows, track=track.astype(np.int64)))
    return folder
