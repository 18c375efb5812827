"""A month of small scenes searched in one process: how much memory, and what of it stays.

    python -m benchmarks.search_memory [--days N] [--limit MB]

A day is 24 runs of an hour in one scene: people walk past parked cars, one of them enters a car
(``benchmarks/activities.py``). Every day is searched for several activities. Peak memory is printed
day by day; the command fails where it exceeds the limit, and where a stage outlives its search.
"""

import argparse
import gc
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import activities
from scene4d import search
from scene4d.searching.predicates.stage import Stage
from scene4d.store.writing import SceneWriter

WORDS = ("person enters vehicle", "two people meet", "crowd forms", "person near vehicle")
RUNS, PEOPLE, VEHICLES = 24, 8_000, 6_000
LIMIT_MB = 1500.0


def write_day(folder: Path) -> None:
    """One scene of many runs, each of them a made hour."""
    for number in range(RUNS):
        tracks, _ = activities.synthetic_day(PEOPLE, VEHICLES, seed=number)
        with SceneWriter(
            folder,
            camera="roof",
            run=f"hour {number:02d}",
            start_utc=None,
            camera_json=activities.calibration().to_dict(),
            provenance={},
        ) as out:
            out.write(tracks)


def peak_mb() -> float:
    """Most memory that the process has ever had."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / (1e6 if sys.platform == "darwin" else 1e3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--limit", type=float, default=LIMIT_MB, help="MB")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="scene4d-month-") as name:
        day = Path(name) / "0"
        write_day(day)
        begun, rows, events = time.perf_counter(), 0, 0
        for number in range(arguments.days):
            scene = day if number == 0 else Path(shutil.copytree(day, Path(name) / f"{number}"))
            for words in WORDS:
                result = search(scene, words)
                rows, events = rows + result.rows, events + len(result.events)
            if number:
                shutil.rmtree(scene)
            print(f"day {number + 1}: peak {peak_mb():,.0f} MB", flush=True)
    alive = sum(isinstance(one, Stage) for one in gc.get_objects())
    taken = time.perf_counter() - begun
    print(f"{rows:,} rows searched in {taken:.0f} s, {events:,} events, {alive} stages alive")
    if peak_mb() > arguments.limit or alive:
        sys.exit(f"expected at most {arguments.limit:,.0f} MB, and no stage alive")


if __name__ == "__main__":
    main()
