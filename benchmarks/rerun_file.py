"""Write a scene for the Rerun viewer and read the file back with Rerun's own SDK.

    pip install 'scene4d[rerun]'
    python -m benchmarks.rerun_file SCENE

The SDK takes 500 MB, more than all else together, so no test installs it.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rerun.chunk import RrdReader

from scene4d.cli.exporting import export_scene
from scene4d.store.query import Scene


def main() -> None:
    scene = Scene.open(sys.argv[1])
    run = scene.runs[0].run
    with TemporaryDirectory() as folder:
        (path,) = export_scene(sys.argv[1], Path(folder) / "scene.rrd", "rerun", run=run)
        size = path.stat().st_size
        chunks = list(RrdReader(path).stream())
    rows: dict[str, int] = {}
    for chunk in chunks:
        kind = "/".join(part for part in str(chunk.entity_path).split("/") if not part.isdigit())
        rows[kind] = rows.get(kind, 0) + chunk.num_rows
    print(f"{path.name}: {size} bytes, {scene.runs[0].rows} rows of the scene")
    for kind, count in sorted(rows.items()):
        print(f"{kind:30s} {count}")
    placed = int(np.isfinite(scene.only(run).tracks().xy_m).all(axis=1).sum())
    gone = rows["/world/paths"]
    if rows["/world/tracks"] != placed + gone:
        raise SystemExit(f"{placed} positions and {gone} ends were written, other rows are there")


if __name__ == "__main__":
    main()
