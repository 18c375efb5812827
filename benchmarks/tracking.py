"""Who is who: association and smoothing on PETS 2009 and MEVA, beside other trackers.

    python -m benchmarks.tracking [--data DIR] [--cache DIR] [--meva DIR]

DIR of --data holds pets2009/ and meva/ (by default $SCENE4D_DATA or ../shared/data). Detections
of the PETS video are kept in --cache. --meva names the unpacked MEVA annotations; without it that
part is left out. Scores come from TrackEval; see tracking_peers.py for what to install where.
"""

import contextlib
import io
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import options_of
from benchmarks.tables import Rows, machine, markdown
from benchmarks.tracking_peers import METHODS, follow
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.tracking._fixed_lag import FixedLagSmoother
from scene4d.tracking._people import locate_people
from scene4d.tracking._sightings import Sightings
from scene4d.tracking._smoothing import Smoothed, smooth
from scene4d.tracking._vehicles import locate_vehicles

PETS_FPS, PETS_FRAMES = 10.0, 795
MEVA_FPS, MEVA_EVERY, MEVA_GROUND_M = 30.0, 3, 1.0
MEVA_CLIPS_PER_CAMERA = 2
MISSED, NOISE = 0.1, 0.02
CHI2_95 = 5.991
LAGS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50)


@dataclass(frozen=True, eq=False)
class Case:
    name: str
    found: Detections
    located: Located
    colour: np.ndarray | None
    truth: Detections
    frames: int
    fps: float
    camera: Camera


def seen_people(video: Path, cache: Path) -> tuple[Detections, np.ndarray]:
    """All that the detector finds above 0.1, with keypoints and colours; once, then from cache."""
    from scene4d.perception.detectors.yolox import YoloxDetector
    from scene4d.perception.keypoints import KeypointEstimator
    from scene4d.perception.objects import colour_histograms
    from scene4d.perception.people import PeopleDetector
    from scene4d.video.reader import open_source

    store = cache / "pets2009-people.npz"
    if not store.is_file():
        detector = YoloxDetector()
        detector.whole_threshold = 0.1
        people = PeopleDetector(detector, KeypointEstimator(), None)
        parts, colours = [], []
        with open_source(video) as source:
            for frame in source.frames():
                parts.append(people.look(frame))
                colours.append(colour_histograms(frame.image_bgr, parts[-1].box_xyxy))
        d = Detections.concatenate(parts)
        cache.mkdir(parents=True, exist_ok=True)
        np.savez(
            store,
            image_size=d.image_size,
            frame=d.frame,
            box_xyxy=d.box_xyxy,
            score=d.score,
            keypoint_uv=d.keypoint_uv,
            keypoint_score=d.keypoint_score,
            keypoint_names=np.array(d.keypoint_names),
            colour=np.concatenate(colours),
        )
    kept = dict(np.load(store))
    colour, size, names = (kept.pop(k) for k in ("colour", "image_size", "keypoint_names"))
    found = Detections.from_boxes(
        (int(size[0]), int(size[1])),
        **kept,
        time_s=kept["frame"] / PETS_FPS,
        keypoint_names=tuple(names.tolist()),
    )
    return found, colour


def pets_cases(data: Path, cache: Path) -> tuple[list[Case], Camera]:
    folder = data / "pets2009"
    camera = read_camera(folder / "View_001.xml")
    assert isinstance(camera, Camera)

    def boxes(name: str) -> Detections:
        return read_annotations(folder / name, image_size=camera.image_size, fps=PETS_FPS)

    truth, rcnn = boxes("PETS2009-S2L1.xml"), boxes("frcnn_det.txt")
    low, colour = seen_people(folder / "vtest.avi", cache)
    usual = low.score >= 0.4
    given = [
        ("PETS, YOLOX", low.select(usual), colour[usual]),
        ("PETS, YOLOX from 0.1", low, colour),
        ("PETS, Faster R-CNN", rcnn, None),
        ("PETS, drawn boxes", truth, None),
    ]
    cases = [
        Case(name, d, locate_people(d, camera), c, truth, PETS_FRAMES, PETS_FPS, camera)
        for name, d, c in given
    ]
    return cases, camera


def meva_cases(data: Path, annotations: Path) -> list[Case]:
    """Annotated actors, every third frame, with 10 % left out and noise of 2 % of their size."""
    cases = []
    for file in sorted((data / "meva" / "cameras").glob("*.krtd")):
        camera = read_camera(file)
        assert isinstance(camera, Camera)
        lowered = replace(camera, t=camera.t + camera.R @ np.array([0.0, 0.0, MEVA_GROUND_M]))
        clips = sorted(annotations.glob(f"*{file.stem}.geom.yml"))[:MEVA_CLIPS_PER_CAMERA]
        cases += [meva_case(clip, lowered, seed) for seed, clip in enumerate(clips)]
    return cases


def meva_case(file: Path, camera: Camera, seed: int) -> Case:
    fps = MEVA_FPS / MEVA_EVERY
    truth = read_annotations(file, image_size=camera.image_size, drop_invalid=True)
    truth = truth.select(
        (truth.frame % MEVA_EVERY == 0) & np.isin(truth.class_name, ["person", "vehicle"])
    )
    truth = replace(truth, frame=truth.frame // MEVA_EVERY, time_s=truth.frame / MEVA_FPS)
    truth = one_number_each(truth)
    rng = np.random.default_rng(seed)
    found = truth.select(rng.random(len(truth)) >= MISSED)
    found = found.select(rng.permutation(len(found)))
    size = found.box_xyxy[:, 2:] - found.box_xyxy[:, :2]
    noise = rng.normal(0, NOISE, (len(found), 4)) * np.tile(size, 2)
    found = replace(found, box_xyxy=found.box_xyxy + noise, track=np.full(len(found), -1))
    people = found.class_name == "person"
    located = locate_vehicles(found, camera).put(
        people, locate_people(found.select(people), camera)
    )
    name = f"MEVA {'.'.join(file.name.split('.')[:2])} {file.name.split('.')[-3]}"
    return Case(name, found, located, None, truth, int(truth.frame.max()) + 1, fps, camera)


def one_number_each(truth: Detections) -> Detections:
    """MEVA numbers actors anew for each activity. Boxes of one class that coincide are one object,
    and so is what begins where something of its class ended: a vehicle at any later time, a person
    within 3 s.
    """
    number = {int(track): int(track) for track in np.unique(truth.track)}

    def root(track: int) -> int:
        while number[track] != track:
            track = number[track]
        return track

    def coincide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        alike = overlap(truth.box_xyxy[a], truth.box_xyxy[b]) > 0.7
        return alike & (truth.class_name[a][:, None] == truth.class_name[b])

    for rows in by_frame(truth, int(truth.frame.max()) + 1):
        for i, j in np.argwhere(np.triu(coincide(rows, rows), 1)):
            number[root(int(truth.track[rows[i]]))] = root(int(truth.track[rows[j]]))
    order = np.lexsort((truth.frame, truth.track))
    edge = np.diff(truth.track[order]) != 0
    last, first = order[np.append(edge, True)], order[np.append(True, edge)]
    wait = truth.time_s[first] - truth.time_s[last][:, None]
    long = np.where(truth.class_name[first] == "person", 3.0, np.inf)
    for i, j in np.argwhere(coincide(last, first) & (wait > 0) & (wait <= long)):
        number[root(int(truth.track[last[i]]))] = root(int(truth.track[first[j]]))
    track = np.array([root(int(t)) for t in truth.track])
    kept = np.unique(np.column_stack([track, truth.frame]), axis=0, return_index=True)[1]
    return replace(truth, track=track).select(np.sort(kept))


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes (n, 4) and (m, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.prod(np.clip(high - low, 0, None), axis=2)
    area = [np.prod(box[:, 2:] - box[:, :2], axis=1) for box in (a, b)]
    return shared / (area[0][:, None] + area[1] - shared)


def by_frame(table: Detections, frames: int) -> list[np.ndarray]:
    order = np.argsort(table.frame, kind="stable")
    return np.split(order, np.searchsorted(table.frame[order], np.arange(1, frames)))


def scores(case: Case, label: np.ndarray) -> dict[str, float]:
    """HOTA, IDF1 and MOTA by TrackEval, people and vehicles told apart."""
    from trackeval.metrics import CLEAR, HOTA, Identity

    kept = label >= 0
    found, label = case.found.select(kept), label[kept]
    true_id = np.unique(case.truth.track, return_inverse=True)[1]
    found_id = np.unique(label, return_inverse=True)[1]
    data: dict[str, object] = {"gt_ids": [], "tracker_ids": [], "similarity_scores": []}
    frames = (by_frame(case.truth, case.frames), by_frame(found, case.frames))
    for true, mine in zip(*frames, strict=True):
        same = case.truth.class_name[true][:, None] == found.class_name[mine]
        alike = overlap(case.truth.box_xyxy[true], found.box_xyxy[mine]) * same
        data["gt_ids"].append(true_id[true])
        data["tracker_ids"].append(found_id[mine])
        data["similarity_scores"].append(alike)
    data |= {
        "num_timesteps": case.frames,
        "num_gt_ids": int(true_id.max()) + 1,
        "num_tracker_ids": int(found_id.max(initial=-1)) + 1,
        "num_gt_dets": len(case.truth),
        "num_tracker_dets": len(found),
    }
    with contextlib.redirect_stdout(io.StringIO()):
        hota, clear, identity = (metric().eval_sequence(data) for metric in (HOTA, CLEAR, Identity))
    return {
        "HOTA": 100 * float(np.mean(hota["HOTA"])),
        "IDF1": 100 * float(identity["IDF1"]),
        "MOTA": 100 * float(clear["MOTA"]),
        "switches": float(clear["IDSW"]),
        "tracks": float(data["num_tracker_ids"]),
    }


def association(cases: list[Case]) -> Rows:
    rows: Rows = [
        ["detections", "tracker", "HOTA", "IDF1", "MOTA", "switches", "tracks (true)",
         "ms per frame", "ratio"],
    ]  # fmt: skip
    for case in cases:
        unit = None
        for method in METHODS:
            if not method.here:
                continue
            label, seconds = follow(
                method, case.found, case.located, case.colour, case.frames, case.fps, case.camera
            )
            unit = seconds if unit is None else unit
            s = scores(case, label)
            true = len(np.unique(case.truth.track))
            rows.append(
                [case.name, method.name, *(f"{s[k]:.1f}" for k in ("HOTA", "IDF1", "MOTA")),
                 f"{s['switches']:.0f}", f"{s['tracks']:.0f} ({true})",
                 f"{1e3 * seconds:.2f}", f"{seconds / unit:.1f}"]
            )  # fmt: skip
            print("  " + " | ".join(rows[-1]), flush=True)
    return rows


def matched(case: Case) -> np.ndarray:
    """The drawn box that every detection shows, -1 where none overlaps it by half."""
    from scipy.optimize import linear_sum_assignment

    out = np.full(len(case.found), -1)
    frames = (by_frame(case.truth, case.frames), by_frame(case.found, case.frames))
    for true, mine in zip(*frames, strict=True):
        alike = overlap(case.found.box_xyxy[mine], case.truth.box_xyxy[true])
        for i, j in zip(*linear_sum_assignment(-alike), strict=True):
            if alike[i, j] >= 0.5:
                out[mine[i]] = true[j]
    return out


def autocorrelation(case: Case, true_xy: np.ndarray, match: np.ndarray) -> Rows:
    """Of the errors of located people, in their own standard deviations, clipped at three."""
    rows = np.flatnonzero((match >= 0) & case.located.known)
    error = case.located.xy_m[rows] - true_xy[match[rows]]
    z = np.linalg.solve(np.linalg.cholesky(case.located.covariance_m2[rows]), error[..., None])
    z = np.clip(z[..., 0] - np.median(z[..., 0], axis=0), -3, 3)
    where = {
        key: i
        for i, key in enumerate(
            zip(case.truth.track[match[rows]], case.found.frame[rows], strict=True)
        )
    }
    values = []
    for lag in LAGS:
        later = ((i, where.get((track, frame + lag))) for (track, frame), i in where.items())
        pairs = np.array([pair for pair in later if pair[1] is not None])
        values.append(float((z[pairs[:, 0]] * z[pairs[:, 1]]).mean() / (z**2).mean()))
    return [
        ["seconds apart", *(f"{lag / case.fps:g}" for lag in LAGS)],
        ["autocorrelation", *(f"{v:.2f}" for v in values)],
    ]


def timed(work: Callable[[], Smoothed]) -> tuple[Smoothed, float]:
    begun = time.perf_counter()
    found = work()
    return found, (time.perf_counter() - begun) / max(len(found), 1)


def streamed(sightings: Sightings, frames: int, fps: float) -> Smoothed:
    """Through the smoother of streams."""
    smoother, parts = FixedLagSmoother(), []
    given = []
    for frame in range(frames):
        rows = np.flatnonzero(sightings.frame == frame)
        given.append(rows)
        out = smoother.update(frame / fps, frame, sightings.select(rows))
        parts += [] if out is None else [out]
    parts.append(smoother.finish())
    whole = Smoothed.joined(parts)
    row = np.append(np.concatenate(given), -1)
    return replace(whole, source=row[whole.source])


def positions(case: Case, camera: Camera) -> list[Rows]:
    """Errors against the drawn boxes on the ground, and how often the ellipses hold the truth."""
    label, _ = follow(
        METHODS[0], case.found, case.located, case.colour, case.frames, case.fps, case.camera
    )
    true_xy, match = locate_people(case.truth, camera).xy_m, matched(case)
    found, clock = case.found, np.arange(case.frames)
    seen = Sightings(
        label, found.class_name, clock[found.frame] / case.fps, found.frame,
        case.located.xy_m, case.located.covariance_m2,
    )  # fmt: skip
    rows: Rows = [["positions", "median", "90 %", "in the 95 % ellipse", "us per row"]]

    def add(name: str, xy: np.ndarray, cov: np.ndarray, source: np.ndarray, s: float) -> None:
        good = (source >= 0) & np.isfinite(xy[:, 0])
        good &= match[source] >= 0
        error = xy[good] - true_xy[match[source[good]]]
        inside = (error * np.linalg.solve(cov[good], error[..., None])[..., 0]).sum(axis=1)
        far = np.hypot(error[:, 0], error[:, 1])
        rows.append(
            [name, f"{np.median(far):.3f} m", f"{np.quantile(far, 0.9):.3f} m",
             f"{(inside < CHI2_95).mean():.1%}", f"{1e6 * s:.1f}"]
        )  # fmt: skip

    add("single sightings", seen.xy_m, seen.covariance_m2, np.arange(len(seen)), 0.0)
    whole, each = timed(lambda: smooth(seen, clock / case.fps, clock))
    add("smoothed", whole.xy_m, whole.covariance_m2, whole.source, each)
    stream, each = timed(lambda: streamed(seen, case.frames, case.fps))
    add("smoothed in a stream", stream.xy_m, stream.covariance_m2, stream.source, each)
    return [rows, autocorrelation(case, true_xy, match)]


def main() -> None:
    parser = options_of(__doc__)
    scratch = Path(tempfile.gettempdir()) / "scene4d-tracking"
    parser.add_argument("--cache", type=Path, default=scratch)
    parser.add_argument("--meva", type=Path, default=None)
    asked = parser.parse_args()
    print(machine())
    for method in METHODS:
        if not method.here:
            print(f"left out, not installed: {method.name}")
    cases, camera = pets_cases(asked.data, asked.cache)
    for rows in positions(cases[0], camera):
        print(f"\n{markdown(rows)}")
    if asked.meva is not None:
        cases += meva_cases(asked.data, asked.meva)
    print(f"\n{markdown(association(cases))}")


if __name__ == "__main__":
    main()
