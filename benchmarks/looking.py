"""What looking only where it is needed costs and saves: python -m benchmarks.looking

    [--data DIR] [--cache DIR] [--only NAME...] [--rates 10 5 2] [--seconds 20]

Recordings with several kinds of scene are tracked twice at each rate: with every network on every
frame, and as ``track`` does. The first is kept in --cache. Of the second: processor time per second
of footage (all threads, without start and figures), passes of the networks, people who stand where
the first has one (within a metre), and the median distance from there. PETS 2009 is held against
its hand-drawn boxes too (HOTA and IDF1 if trackeval is installed). Cameras are the true ones, or
those that ``calibrate`` finds, which are kept too.
"""

import argparse
import importlib.util
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks import options_of
from benchmarks.recordings import lab
from benchmarks.tables import Rows, machine, markdown
from benchmarks.throughput import cut
from benchmarks.tracking import PETS_FPS, Case, scores
from benchmarks.tracks import matched, recall
from scene4d import calibrate
from scene4d.core import progress
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Tracks
from scene4d.evaluation import pets, towncentre
from scene4d.formats.annotations import read_annotations
from scene4d.perception import _session
from scene4d.perception.keypoints import INPUT_SIZE
from scene4d.store.query import Scene
from scene4d.tracking import TrackOptions, track, watching
from scene4d.tracking._people import locate_people
from scene4d.video.reader import open_source

NEAR_M = 1.0
CLIPS = {
    "PETS 2009": "pets2009/vtest.avi",
    "lab": "footage/lab/cam0.mp4",
    "TownCentre": "footage/towncentre/tc_1080p_orig0-251.mp4",
    "crosswalk": "footage/streets/crosswalk_640x352_13s.mp4",
    "road": "footage/streets/road_shadows_854x480_31s.mp4",
    "plaza": "footage/streets/plaza_960x540_14s.mp4",
    "car park": "footage/generated/veo_person_enters_vehicle_8s.mp4",
}


EVERYTHING = "everything"


@dataclass(frozen=True, eq=False)
class Run:
    """``processor_s`` is per second of footage, ``passes`` of networks (people for keypoints)."""

    tracks: Tracks
    passes: Counter
    processor_s: dict[str, float]


def camera_of(name: str, data: Path, cache: Path) -> Camera | Path:
    """The true camera, or one found from the footage."""
    video = data / CLIPS[name]
    if name == "PETS 2009":
        return pets(data / "pets2009").camera
    if name == "lab":
        return lab(0, data)[0].camera
    if name == "TownCentre":
        return towncentre(data / "towncentre").camera
    found = cache / "cameras" / video.stem / "camera.json"
    if not found.is_file():
        calibrate(video).save(found.parent)
    return found


def counted(passes: Counter, kind: type) -> Any:
    """Counts what a kind of session runs, by the shape of its input."""
    plain = kind.run

    def run(self: Any, names: Any, given: dict[str, np.ndarray], **more: Any) -> Any:
        ((n, _, height, width),) = (np.shape(value) for value in given.values())
        square = {608: "vehicles"}.get(width if width == height else 0, "people")
        passes["keypoints" if (width, height) == INPUT_SIZE else square] += n
        return plain(self, names, given, **more)

    return mock.patch.object(kind, "run", run)


def tracked(video: Path, camera: Camera | Path, out: Path, rate: float, attentive: bool) -> Run:
    """One run of ``track``, its figures not counted."""
    passes: Counter = Counter()
    plain = watching.detectors
    with ExitStack() as stack:
        for kind in (_session._Session, _session._Vino):
            stack.enter_context(counted(passes, kind))
        clock = SimpleNamespace(perf_counter=time.process_time)
        stack.enter_context(mock.patch.object(progress, "time", clock))
        if not attentive:
            everything = lambda job: replace(plain(job), attention=None)  # noqa: E731
            stack.enter_context(mock.patch.object(watching, "detectors", everything))
        begun = time.process_time()
        run = track(video, camera, out, TrackOptions(rate_hz=rate))
    took = {"all": time.process_time() - begun - run.timings.pop("draw", 0.0), **run.timings}
    with open_source(video) as source:
        seconds = source.timeline.time_s[-1]
    each = {name: s / seconds for name, s in took.items()}
    return Run(Scene.open(out).tracks(), passes, each)


def agreement(whole: Tracks, now: Tracks) -> list[str]:
    """How many people of the first stand where the second has one, and how far apart they are."""
    found, far = 0, []
    here = ((t.class_name == "person") & np.isfinite(t.xy_m[:, 0]) for t in (whole, now))
    whole, now = (t.select(rows) for t, rows in zip((whole, now), here, strict=True))
    for frame in np.unique(whole.frame):
        rows, there = (np.flatnonzero(t.frame == frame) for t in (whole, now))
        apart = np.linalg.norm(whole.xy_m[rows][:, None] - now.xy_m[there][None], axis=2)
        i, j = linear_sum_assignment(np.minimum(apart, 10 * NEAR_M))
        good = apart[i, j] < NEAR_M
        found += int(good.sum())
        far += apart[i, j][good].tolist()
    median = float(np.median(far)) if far else np.nan
    return [f"{found / max(len(whole), 1):.1%}", f"{median:.3f} m"]


def against_truth(tracks: Tracks, truth: Detections, camera: Camera) -> str:
    """Of PETS: HOTA and IDF1 of what was seen, recall at 1.5 m, median error."""
    people = tracks.select(tracks.class_name == "person")
    true_xy = locate_people(truth, camera).xy_m
    rows, there = matched(truth, people)
    far = np.linalg.norm(true_xy[rows] - people.xy_m[there], axis=1)
    said = [
        f"recall {recall(truth, true_xy, people, people.xy_m):.1%}",
        f"median {np.nanmedian(far):.3f} m",
    ]
    if importlib.util.find_spec("trackeval"):
        seen = people.select(people.observed)
        found = Detections.from_boxes(
            camera.image_size, seen.frame, seen.box_xyxy, track=seen.track
        )
        nowhere = locate_people(found, camera)
        frames = int(truth.frame.max()) + 1
        case = Case("PETS", found, nowhere, None, truth, frames, PETS_FPS, camera)
        each = scores(case, seen.track)
        said = [f"{name} {each[name]:.1f}" for name in ("HOTA", "IDF1", "MOTA")] + said
    return ", ".join(said)


def compared(name: str, rate: float, asked: argparse.Namespace, scratch: Path) -> list[str]:
    """A row of the table."""
    source, camera = asked.data / CLIPS[name], camera_of(name, asked.data, asked.cache)
    video = asked.cache / f"{source.stem}-{asked.seconds:g}s{source.suffix}"
    if not video.is_file():
        cut(source, asked.seconds, video)
    kept = asked.cache / f"{source.stem}-{asked.seconds:g}s-{rate:g}Hz-{_session.engine()}"
    if not kept.is_dir():
        tracked(video, camera, kept, rate, attentive=False)
    whole = Scene.open(kept).tracks()
    now = tracked(video, camera, scratch / f"{name}-{rate:g}", rate, attentive=True)
    counts = [
        ", ".join(f"{n} {kind}" for kind, n in sorted(Counter(_kinds(t)).items()))
        for t in (whole, now.tracks)
    ]
    stages = ("detect people", "detect vehicles", "keypoints", "decode")
    row = [name, f"{rate:g} Hz", f"{now.processor_s['all']:.2f} s"]
    row += [f"{now.processor_s.get(stage, 0.0):.3f}" for stage in stages]
    row += [str(now.passes[what]) for what in ("people", "vehicles", "keypoints")]
    row += [*agreement(whole, now.tracks), *counts]
    print("  " + " | ".join(row), flush=True)
    if name == "PETS 2009":
        folder = asked.data / "pets2009"
        true = pets(folder)
        truth = read_annotations(folder / "PETS2009-S2L1.xml", image_size=true.image_size)
        last = int(whole.frame.max())
        step = round(PETS_FPS / rate)
        truth = truth.select((truth.frame <= last) & (truth.frame % step == 0))
        for what, tracks in ((EVERYTHING, whole), ("now", now.tracks)):
            print(f"    {what}: {against_truth(tracks, truth, true.camera)}", flush=True)
    return row


def _kinds(tracks: Tracks) -> list[str]:
    """The class of every track."""
    first = np.unique(tracks.track, return_index=True)[1]
    return [str(kind) for kind in tracks.class_name[first]]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "looking")
    parser.add_argument("--only", nargs="+", choices=CLIPS, default=list(CLIPS))
    parser.add_argument("--rates", type=float, nargs="+", default=[10.0, 5.0, 2.0])
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args()
    asked.cache.mkdir(parents=True, exist_ok=True)
    print(f"{machine()} {_session.engine()}")
    rows: Rows = [
        ["footage", "rate", "processor time per s", "people", "vehicles", "keypoints", "decode",
         "passes: people", "vehicles", "people with keypoints", "where everything has one",
         "apart", "tracks: everything", "now"],
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        rows += [compared(n, r, asked, Path(scratch)) for n in asked.only for r in asked.rates]
    print(f"\n{markdown(rows)}")


if __name__ == "__main__":
    main()
