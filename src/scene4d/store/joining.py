"""Scenes of one camera made one, with a number of its own for every track."""

from collections.abc import Iterable
from pathlib import Path

from scene4d.core.files import read_json
from scene4d.store.query import Scene
from scene4d.store.runs import camera_path, complete_runs
from scene4d.store.writing import SceneWriter


def join(scenes: Iterable[Path], out: Path) -> Path:
    """Write the runs of several scenes that hold somebody into one, one run in memory at a time.

    Raises as :class:`Scene` and :class:`SceneWriter` do.
    """
    for folder in scenes:
        for run in complete_runs(folder):
            if not run.rows:
                continue
            with SceneWriter(
                out,
                camera=run.camera,
                run=run.run,
                start_utc=run.start,
                camera_json=read_json(camera_path(folder, run.camera)),
                provenance=run.provenance,
            ) as writer:
                writer.write(Scene.open(folder).only(run.run).tracks())
    return out
