"""Time and memory of the solver and of a whole calibration.

    python benchmarks/speed.py [--data DIR]

The solver on synthetic people (10 % truncated); `scene4d calibrate` on the PETS video by stage; the
time until `scene4d --help` has printed. Close other programs first: busy cores double everything.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

from scene4d.calibration import solve_camera
from scene4d.model import Camera
from scene4d.pipeline import Options, Silent, run, write

ROOT = Path(__file__).parents[1]
CAMERA = Camera.from_pose(
    image_size=(1920, 1080), focal_px=1500.0, tilt_rad=0.4, roll_rad=0.02, height_m=6.0
)


def people(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Feet and heads (n, 2) of people of 1.70 ± 0.09 m, 2 px noise, one in ten cut at the feet."""
    rng = np.random.default_rng(seed)
    xy = np.column_stack([rng.uniform(-8, 8, 4 * n + 100), rng.uniform(8, 40, 4 * n + 100)])
    fits = CAMERA.project(np.column_stack([xy, np.full(len(xy), 2.1)]))[0]
    feet = CAMERA.project(np.column_stack([xy, np.full(len(xy), 0.04)]))[0]
    inside = ((fits > 0) & (feet > 0) & (fits < (1920, 1080)) & (feet < (1920, 1080))).all(axis=1)
    xy, feet = xy[inside][:n], feet[inside][:n]
    heads = CAMERA.project(np.column_stack([xy, rng.normal(1.70, 0.09, n)]))[0]
    heads += rng.normal(0, 2, (n, 2))
    cut = rng.random(n) < 0.1
    feet[cut] = heads[cut] + (feet[cut] - heads[cut]) * rng.uniform(0.3, 0.85, (cut.sum(), 1))
    return feet, heads


def solver() -> None:
    print("| people | median ms | peak MB |\n| --- | --- | --- |")
    for n in (10, 100, 1_000, 10_000, 100_000):
        feet, heads = people(n)
        seconds = []
        for _ in range(15 if n <= 10_000 else 5):
            begun = time.perf_counter()
            solve_camera(feet, heads, image_size=CAMERA.image_size)
            seconds.append(time.perf_counter() - begun)
        tracemalloc.start()
        solve_camera(feet, heads, image_size=CAMERA.image_size)
        peak = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
        print(f"| {n:,} | {statistics.median(seconds) * 1e3:.1f} | {peak:.0f} |")


def whole(video: Path, out: Path) -> None:
    begun = time.perf_counter()
    result = run(video, Options(), Silent())
    write(result, out, command=None, progress=Silent())
    total = time.perf_counter() - begun
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print("\n| stage of calibrate | s |\n| --- | --- |")
    for stage, seconds in result.timings.items():
        print(f"| {stage} | {seconds:.2f} |")
    print(f"| **all** | **{total:.1f}** |\n\npeak memory {memory:.2f} GB")


def startup() -> None:
    command = "from scene4d.cli import main; main()"
    for arguments in (["-c", "import scene4d"], ["-c", command, "--help"]):
        seconds = []
        for _ in range(7):
            begun = time.perf_counter()
            subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
            seconds.append(time.perf_counter() - begun)
        print(f"python {' '.join(arguments)}: {statistics.median(seconds):.2f} s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("SCENE4D_DATA", ROOT.parent / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "speed")
    arguments = parser.parse_args()
    solver()
    whole(arguments.data / "pets2009" / "vtest.avi", arguments.out)
    print()
    startup()


if __name__ == "__main__":
    main()
