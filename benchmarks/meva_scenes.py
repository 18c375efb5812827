"""All annotated clips of MEVA as scenes: how long it takes, and whether parked vehicles stay put.

    python -m benchmarks.meva_scenes [--data DIR] [--clips N]

DIR holds meva/. A vehicle counts as parked where the boxes of its track do not move.
"""

import tarfile
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import options_of
from benchmarks.vehicle_positions import stands
from scene4d.core.errors import Scene4DError
from scene4d.store.query import Scene
from scene4d.tracking import TrackOptions, track


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--clips", type=int, default=None)
    arguments = parser.parse_args()
    meva = arguments.data / "meva"
    with tempfile.TemporaryDirectory() as scratch:
        with tarfile.open(meva / "annotations.tar.xz") as archive:
            archive.extractall(scratch, filter="data")
        clips = sorted(Path(scratch).rglob("*.geom.yml"))[: arguments.clips]
        begun, rows, refused = time.perf_counter(), 0, []
        out = Path(scratch) / "scene"
        for clip in clips:
            camera = clip.name.split(".")[-3]
            path = meva / "cameras" / f"{camera}.krtd"
            options = TrackOptions(
                annotations=clip,
                name=camera,
                fps=30.0,
                drop_invalid=True,
            )
            try:
                rows += track(None, path, out, options).rows
            except Scene4DError as error:
                refused.append(f"{clip.name}: {error}")
        taken = time.perf_counter() - begun
        print(f"{len(clips)} clips, {rows:,} rows in {taken:.1f} s; refused {len(refused)}")
        print("\n".join(refused))
        tracks = Scene.open(out).tracks(classes=["vehicle"])
        spread = []
        _, starts = np.unique(tracks.track, return_index=True)
        for rows_of in np.split(np.arange(len(tracks)), starts[1:]):
            one = tracks.select(rows_of)
            known = np.isfinite(one.xy_m[:, 0])
            if known.sum() >= 10 and stands(one.box_xyxy[one.observed]):
                spread.append(np.sqrt(one.xy_m[known].var(axis=0).sum()))
        spread = np.array(spread)
        print(
            f"{len(spread)} parked vehicles: sd median {np.median(spread):.3f} m, "
            f"90 % {np.quantile(spread, 0.9):.3f} m, {np.mean(spread <= 0.3):.1%} within 0.3 m"
        )


if __name__ == "__main__":
    main()
