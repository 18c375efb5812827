"""How good tracks are on the ground: PETS S2L1 against its hand-drawn boxes and true camera.

    python -m benchmarks.tracks [--data DIR] [--out DIR] [--write]

Calibrates the camera from the video, tracks with it and with the true camera, and compares with the
true positions: the hand-drawn boxes through the true camera, moved from the near rim of the body to
its axis. DIR of --out keeps the scenes, so that a second run does not detect again. With --write
the table replaces what stands between the markers in README.md.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks import ROOT, options_of
from scene4d.calibration.calibrating import run
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.writing import write
from scene4d.core.camera import Camera
from scene4d.core.geometry import rigid_fit
from scene4d.core.people import Detections
from scene4d.core.progress import Silent
from scene4d.core.tracks import Tracks
from scene4d.evaluation import pets
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import write_camera
from scene4d.store.query import Scene
from scene4d.tracking import track
from scene4d.tracking._people import locate_people

BEGIN, END = "<!-- tracks: begin -->", "<!-- tracks: end -->"
SAME_IOU, REACH_M = 0.3, 1.5
ELLIPSE = 5.991
"""95 % quantile of chi-squared with two degrees of freedom."""


def overlaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    inter = np.clip(high - low, 0, None).prod(axis=2)
    area_a, area_b = ((x[:, 2:] - x[:, :2]).prod(axis=1) for x in (a, b))
    return inter / (area_a[:, None] + area_b[None] - inter)


def matched(truth: Detections, tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
    """Rows of true boxes and of observed tracks that are the same person: by overlap alone."""
    pairs = []
    for frame in np.unique(truth.frame):
        rows = np.flatnonzero(truth.frame == frame)
        there = np.flatnonzero((tracks.frame == frame) & tracks.observed)
        if not len(there):
            continue
        iou = overlaps(truth.box_xyxy[rows], tracks.box_xyxy[there])
        i, j = linear_sum_assignment(-iou)
        good = iou[i, j] > SAME_IOU
        pairs.append(np.column_stack([rows[i[good]], there[j[good]]]))
    both = np.concatenate(pairs)
    return both[:, 0], both[:, 1]


def recall(truth: Detections, true_xy: np.ndarray, tracks: Tracks, xy: np.ndarray) -> float:
    """Share of the true people with a track within reach, one each."""
    found = 0
    for frame in np.unique(truth.frame):
        rows = np.flatnonzero((truth.frame == frame) & np.isfinite(true_xy[:, 0]))
        there = np.flatnonzero((tracks.frame == frame) & np.isfinite(xy[:, 0]))
        apart = np.linalg.norm(true_xy[rows][:, None] - xy[there][None], axis=2)
        i, j = linear_sum_assignment(np.minimum(apart, 10 * REACH_M))
        found += int((apart[i, j] < REACH_M).sum())
    return found / int(np.isfinite(true_xy[:, 0]).sum())


def scored(scene: Path, truth: Detections, camera: Camera) -> list[str]:
    tracks = Scene.open(scene).tracks(classes=["person"])
    true_xy = locate_people(truth, camera).xy_m
    rows, there = matched(truth, tracks)
    known = np.isfinite(true_xy[rows, 0]) & np.isfinite(tracks.xy_m[there, 0])
    rows, there = rows[known], there[known]
    R, t = rigid_fit(tracks.xy_m[there], true_xy[rows])
    xy = tracks.xy_m @ R.T + t
    off = np.linalg.norm(xy[there] - true_xy[rows], axis=1)
    total = tracks.covariance_m2[there] + tracks.shared_covariance_m2[there]
    inside = []
    for covariance in (tracks.covariance_m2[there], total):
        turned = R @ covariance @ R.T
        error = xy[there] - true_xy[rows]
        d2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(turned), error)
        inside.append(f"{np.mean(d2 < ELLIPSE):.1%}")
    return [
        f"{np.median(off):.2f} m",
        f"{np.quantile(off, 0.9):.2f} m",
        f"{recall(truth, true_xy, tracks, xy):.1%}",
        *inside,
        f"{len(np.unique(tracks.track))}",
    ]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--write", action="store_true", help="put the table into README.md")
    arguments = parser.parse_args()
    reference = pets(arguments.data / "pets2009")
    video = arguments.data / "pets2009" / "vtest.avi"
    truth = read_annotations(
        arguments.data / "pets2009" / "PETS2009-S2L1.xml", image_size=reference.image_size
    )
    with tempfile.TemporaryDirectory() as scratch:
        out = arguments.out or Path(scratch)
        write(
            run(video, CalibrateOptions(), Silent()),
            out / "camera",
            progress=Silent(),
        )
        write_camera(reference.camera, out / "true.json", "json")
        cameras = {"calibrated from the video": out / "camera" / "camera.json"}
        cameras["the true camera"] = out / "true.json"
        head = ["camera", "median", "90 %", f"recall at {REACH_M} m"]
        head += ["in 95 % ellipse", "with the camera's part", "tracks"]
        rows = [head, ["---"] * len(head)]
        for number, (name, camera) in enumerate(cameras.items()):
            scene = out / f"scene{number}"
            done = track(video, camera, scene)
            rows.append([name, *scored(scene, truth, reference.camera)])
            print(name, {k: round(v, 2) for k, v in done.timings.items()})
    text = "\n".join("| " + " | ".join(cells) + " |" for cells in rows)
    print(text)
    if arguments.write:
        readme = ROOT / "README.md"
        before, rest = readme.read_text().split(BEGIN)
        readme.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main()
