"""A fleet's cost beside its work: python -m benchmarks.fleet [--part workers|overhead|many|plan]

``workers``: annotated clips tracked one at a time on Ray, and one on each core. ``overhead``: such
clips, and the sample video, in one process, by the fleet and by ``track`` alone. ``many``: 10,000
clips that take no time, and the memory of the program. ``plan``: the sample video tracked, and what
follows for 500 cameras and a month.
"""

import argparse
import os
import resource
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "fleet"), str(ROOT / "tests")]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))

from fleet_plans import FPS, boxes, nothing_work, plan  # noqa: E402

from benchmarks.tables import Rows, markdown  # noqa: E402
from scene4d.fleet import Plan, read_plan, run_fleet  # noqa: E402
from scene4d.fleet._executors import LOCAL  # noqa: E402
from scene4d.tracking import TrackOptions, track  # noqa: E402

CLIPS, TURNS, MANY = 8, 2, 10_000
CAMERAS, DAYS = 500, 30
FOOTAGE_GB_PER_H = 1.0
"""Chosen: H.264 of a street camera at 2.2 Mbit/s."""
RATE_HZ = 5.0


def cpu_s() -> float:
    """Of this process and of its children that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def workers(place: Path) -> Rows:
    """One clip at a time, which takes all cores for itself, and one for each core, in turns."""
    folder, most = boxes(place, clips=CLIPS), os.cpu_count() or 1
    clips_per_s: dict[int, list[float]] = {1: [], most: []}
    work_s: dict[int, list[float]] = {1: [], most: []}
    for turn in range(TURNS):
        for number in clips_per_s:
            asked = read_plan(plan(folder, f"workers: {{cores: {most // number}, memory_gb: 1}}"))
            store = place / f"store-{number}-{turn}"
            said = run_fleet(asked, store, ray=LOCAL).to_dict()
            ended = sorted(one.stat().st_mtime for one in (store / "done").iterdir())
            warm = ended[2 * most :]  # the first ones of each worker wait for it to load
            clips_per_s[number].append(len(warm) / (warm[-1] - ended[2 * most - 1]))
            work_s[number].append(said["cpu_h"] * 3600 / said["done"])
    rows: Rows = [["at a time", "clips", "clips a second", "processor time of a clip", "speed-up"]]
    for number, found in clips_per_s.items():
        ratios = [many / one for one, many in zip(clips_per_s[1], found, strict=True)]
        rows.append([
            str(number), str(2 * CLIPS), f"{max(found):.2f}",
            f"{min(work_s[number]) * 1e3:.0f} ms", f"{statistics.median(ratios):.2f}",
        ])  # fmt: skip
    return rows


def overhead(place: Path) -> Rows:
    """Processor time of the fleet in one process, and of its work alone: short clips with boxes,
    and the sample video.
    """
    short, sample = place / "short", _sample_folder(place / "sample")
    short.mkdir()
    boxes(short, clips=CLIPS)
    boxed = TrackOptions(fps=float(FPS), rate_hz=5.0, format="mot")
    rows: Rows = [["clips", "track alone", "fleet", "the fleet adds", "of its work"]]
    for name, asked, options in (
        (f"{2 * CLIPS} with boxes", read_plan(plan(short)), boxed),
        ("the sample video", read_plan(sample / "plan.yaml"), TrackOptions(rate_hz=RATE_HZ)),
    ):
        track_s, fleet_s = _beside(place / name, asked, options)
        rows.append([
            name, f"{track_s:.3f} s a clip", f"{fleet_s:.3f} s a clip",
            f"{fleet_s - track_s:.3f} s a clip", f"{fleet_s / track_s - 1:.1%}",
        ])  # fmt: skip
    return rows


def _beside(place: Path, asked: Plan, options: TrackOptions) -> tuple[float, float]:
    """Processor seconds of a clip by ``track`` and by the fleet, the least of their turns."""
    clips = [(camera, clip) for camera in asked.cameras for clip in camera.clips]

    def alone(out: Path) -> None:
        for number, (camera, clip) in enumerate(clips):
            track(
                None if camera.boxes else str(clip),
                camera.camera,
                out / str(number),
                options,
                annotations=clip if camera.boxes else None,
                name=camera.name,
                start=camera.begins(clip),
            )

    alone(place / "warm")
    took: dict[str, list[float]] = {"track": [], "fleet": []}
    for turn in range(TURNS):
        for name, used in took.items():
            begun_s = cpu_s()
            if name == "track":
                alone(place / f"track-{turn}")
            else:
                run_fleet(asked, place / f"fleet-{turn}")
            used.append((cpu_s() - begun_s) / len(clips))
    return min(took["track"]), min(took["fleet"])


def many(place: Path) -> Rows:
    """10,000 clips on Ray, and the largest size of the program."""
    folder = place / "clips"
    for camera in range(100):
        (folder / f"c{camera}").mkdir(parents=True)
        for clip in range(MANY // 100):
            (folder / f"c{camera}" / f"{clip}.txt").write_text(f"{camera} {clip}")
    lines = [
        "cameras:",
        *(f"  c{n}: {{boxes: c{n}/*.txt, camera: camera.json}}" for n in range(100)),
    ]
    (folder / "plan.yaml").write_text("\n".join([*lines, "track: {}", "workers: {memory_gb: 0.5}"]))
    (folder / "camera.json").write_text("{}")
    begun_s = time.perf_counter()
    said = run_fleet(folder / "plan.yaml", place / "store", ray=LOCAL, work=nothing_work).to_dict()
    took_s = time.perf_counter() - begun_s
    assert said["done"] == MANY, said
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begun_s = time.perf_counter()
    again = run_fleet(folder / "plan.yaml", place / "store", work=nothing_work).to_dict()
    assert again["earlier"] == MANY
    again_s = time.perf_counter() - begun_s
    return [
        ["clips", "time passed", "a clip", "memory of the program", "the same again"],
        [
            f"{MANY:,}",
            f"{took_s:.0f} s",
            f"{took_s / MANY * 1e3:.1f} ms",
            f"{peak_mb:.0f} MB",
            f"{again_s:.0f} s",
        ],
    ]


def _sample_folder(place: Path) -> Path:
    """The sample video with its camera, and a plan that tracks it."""
    from scene4d.calibration.calibrating import run_detections
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.writing import write
    from scene4d.core.progress import Silent
    from scene4d.formats.demo import demo_detections
    from scene4d.video.sample import sample_video

    place.mkdir()
    found = run_detections(demo_detections(), CalibrateOptions(), Silent(), "sample")
    write(found, place / "camera", progress=Silent())
    (place / "plan.yaml").write_text(
        f"cameras: {{pets: {{footage: '{sample_video(place)}', camera: camera/camera.json}}}}\n"
        f"track: {{rate_hz: {RATE_HZ:g}}}\n"
    )
    return place


def _tracked_s(place: Path) -> tuple[float, float]:
    """Processor seconds and bytes in the store for a second of the sample video."""
    said = run_fleet(_sample_folder(place / "sample") / "plan.yaml", place / "store").to_dict()
    assert said["done"] == 1, said
    size = sum(path.stat().st_size for path in (place / "store").rglob("*.parquet"))
    return said["cpu_h_per_camera_hour"], size / (said["footage_h"] * 3600)


def planned(place: Path) -> Rows:
    """What 500 cameras and a month take, if all are like the sample."""
    cpu, bytes_per_s = _tracked_s(place)
    hours = CAMERAS * DAYS * 24
    footage_tb = hours * FOOTAGE_GB_PER_H / 1e3
    store_tb = hours * 3600 * bytes_per_s / 1e12
    keep_up = CAMERAS * cpu
    rows: Rows = [["to be done in", "cores", "footage read", "store written"]]
    for name, days in (("a month, as it comes", DAYS), ("a week", 7), ("a day", 1)):
        read = 2 * footage_tb * 1e6 / (days * 86_400)  # once for its hash, once to be decoded
        written = store_tb * 1e6 / (days * 86_400)
        cores = f"{keep_up * DAYS / days:,.0f}"
        rows.append([name, cores, f"{read:,.0f} MB/s", f"{written:,.1f} MB/s"])
    rows.append([
        f"in all ({hours:,} camera-hours)", f"{hours * cpu:,.0f} core-hours",
        f"{footage_tb:,.0f} TB, twice", f"{store_tb:.1f} TB",
    ])  # fmt: skip
    return rows


PARTS = {"workers": workers, "overhead": overhead, "many": many, "plan": planned}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=PARTS)
    given = parser.parse_args()
    for name in [given.part] if given.part else PARTS:
        with tempfile.TemporaryDirectory(prefix="fleet-") as place:
            print(f"{name} (load of the machine: {os.getloadavg()[0]:.1f})", flush=True)
            print(markdown(PARTS[name](Path(place))), flush=True)


if __name__ == "__main__":
    main()
