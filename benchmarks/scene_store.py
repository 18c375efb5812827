"""A scene of a million rows, written and filtered: python benchmarks/scene_store.py

The rows are those of people with 26 keypoints and of cars without, 10 a second of each of 150
objects. They are handed over a second at a time, as tracking does. The question is one minute in
ten by ten metres. Beside it pyarrow writes and filters the same rows with the same compression, and
pandas, where it is installed. Memory is that of a process of its own for each number of rows.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from scene4d.core.tracks import Tracks
from scene4d.store.query import Scene
from scene4d.store.writing import SceneWriter

OBJECTS, PER_SECOND, KEYPOINTS = 150, 10, 26
START = datetime(2009, 6, 1, 8, tzinfo=UTC)
BEGIN_S, END_S, PLACE_M = 300.0, 360.0, (-5.0, -5.0, 5.0, 5.0)
TARGET_WRITE_S, TARGET_FILTER_S = 3.0, 0.1
REPEATS = 7


def seconds(rows: int, keypoints: int) -> Iterator[Tracks]:
    """Tracks of one second after the other, ``rows`` in all."""
    rng = np.random.default_rng(0)
    n = OBJECTS * PER_SECOND
    track = np.repeat(np.arange(OBJECTS), PER_SECOND)
    tick = np.tile(np.arange(PER_SECOND), OBJECTS)
    car = track % 3 == 0
    start, speed = rng.uniform(-20, 20, (OBJECTS, 2)), rng.normal(0, 0.05, (OBJECTS, 2))
    for second in range(-(-rows // n)):
        time_s = second + tick / PER_SECOND
        xy = start[track] + speed[track] * time_s[:, None] + rng.normal(0, 0.02, (n, 2))
        box = np.column_stack([xy, xy + 2.0]) * 15 + 400 + rng.normal(0, 1, (n, 4))
        uv = box[:, None, :2] + rng.uniform(0, 40, (n, keypoints, 2))
        uv[car] = np.nan
        covariance = np.zeros((n, 2, 2))
        covariance[:, (0, 1), (0, 1)] = rng.uniform(0.01, 0.1, (n, 2))
        tracks = Tracks(
            track=track,
            class_name=np.where(car, "car", "person"),
            time_s=time_s,
            frame=second * PER_SECOND + tick,
            xy_m=xy,
            covariance_m2=covariance,
            shared_covariance_m2=covariance * 0.3,
            velocity_mps=speed[track],
            velocity_covariance=covariance * 0.1,
            heading_rad=np.arctan2(*speed[track].T[::-1]),
            heading_sigma_rad=rng.uniform(0.05, 0.2, n),
            box_xyxy=box,
            keypoint_uv=uv,
            keypoint_score=np.where(car[:, None], 0.0, rng.random((n, keypoints))),
            score=rng.random(n),
            observed=rng.random(n) < 0.95,
        )
        yield tracks.select(np.arange(min(n, rows - second * n)))


def write(folder: Path, pieces: Iterator[Tracks] | list[Tracks]) -> None:
    with SceneWriter(
        folder, camera="north", run="day", start_utc=START, camera_json={}, provenance={}
    ) as out:
        for tracks in pieces:
            out.write(tracks)


def timed(work: Callable[[], object], repeats: int = 1) -> float:
    """Seconds that it takes, the median."""
    took = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        took.append(time.perf_counter() - begin)
    return float(np.median(took))


def peak_mb(rows: int) -> float:
    """Memory of a process that writes so many rows, made second by second."""
    command = [sys.executable, __file__, "--peak", str(rows)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def peers(files: list[Path], folder: Path, wrote_s: float, filtered_s: float) -> None:
    """The same rows by others, as multiples of what scene4d takes."""
    try:
        import pyarrow.dataset as ds
        import pyarrow.parquet as pq
    except ImportError:
        return
    dataset = ds.dataset(files)
    rows = dataset.to_table()
    options = {"compression": "zstd", "compression_level": 1, "row_group_size": 32_768}
    took = timed(lambda: pq.write_table(rows, folder / "arrow.parquet", **options))
    size = (folder / "arrow.parquet").stat().st_size / 1e6
    print(
        f"  pyarrow, table given: written in {took:.2f} s ({took / wrote_s:.2f} x), {size:.0f} MB"
    )
    x0, y0, x1, y1 = PLACE_M
    where = (ds.field("time_s") >= BEGIN_S) & (ds.field("time_s") < END_S)
    where &= (ds.field("x_m") >= x0) & (ds.field("x_m") <= x1)
    where &= (ds.field("y_m") >= y0) & (ds.field("y_m") <= y1)
    took = timed(lambda: dataset.to_table(filter=where), REPEATS)
    found = dataset.to_table(filter=where).num_rows
    print(f"  pyarrow: filtered in {took:.4f} s ({took / filtered_s:.1f} x), {found} rows")
    try:
        import pandas
    except ImportError:
        return

    def by_pandas() -> int:
        f = pandas.concat([pandas.read_parquet(path) for path in files])
        f = f[(f.time_s >= BEGIN_S) & (f.time_s < END_S)]
        return len(f[f.x_m.between(x0, x1) & f.y_m.between(y0, y1)])

    took = timed(by_pandas)
    print(f"  pandas, all read: filtered in {took:.2f} s ({took / filtered_s:.0f} x)")


def measure(rows: int, keypoints: int) -> bool:
    """Print one table; whether the targets are met."""
    pieces = list(seconds(rows, keypoints))
    with tempfile.TemporaryDirectory(prefix="scene4d-store-") as name:
        folder = Path(name) / "scene"
        cpu = time.process_time()
        wrote = min(timed(partial(write, folder, pieces)) for _ in range(3))
        cpu = (time.process_time() - cpu) / 3
        files = sorted(folder.glob("tracks/camera=*/day=*/*.parquet"))
        size = sum(path.stat().st_size for path in files)

        def ask() -> int:
            return scene.rows(begin=BEGIN_S, end=END_S, within_m=PLACE_M).num_rows

        begin = time.perf_counter()
        scene = Scene.open(folder)
        found = ask()
        first = time.perf_counter() - begin
        filtered = timed(ask, REPEATS)
        print(f"{rows} rows, people with {keypoints} keypoints")
        print(
            f"  written in {wrote:.2f} s, best of 3, {cpu:.2f} s of one core "
            f"(target {TARGET_WRITE_S} s)"
        )
        print(f"  {size / 1e6:.0f} MB in {len(files)} files, {size / rows:.0f} bytes a row")
        print(f"  opened and filtered in {first:.3f} s, then in {filtered:.4f} s "
              f"(target {TARGET_FILTER_S} s), {found} rows")  # fmt: skip
        peers(files, Path(name), wrote, filtered)
    return wrote <= TARGET_WRITE_S and filtered <= TARGET_FILTER_S


def main() -> int:
    """Print what was measured; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak is not None:
        with tempfile.TemporaryDirectory(prefix="scene4d-store-") as name:
            write(Path(name), seconds(options.peak, KEYPOINTS))
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
        return 0
    # First, since on Linux a process inherits the peak of its parent.
    for rows in (options.rows // 8, options.rows // 4, options.rows // 2, options.rows):
        print(f"peak memory while {rows} rows are written: {peak_mb(rows):.0f} MB")
    met = [measure(options.rows, keypoints) for keypoints in (0, KEYPOINTS)]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
