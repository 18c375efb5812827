"""What a detector makes of annotated boxes: simulated, as ours errs on PETS S2L1.

    python -m benchmarks.simulated_detector [--data DIR]

Tracks PETS with the true camera and compares what was detected, before tracking, with the
hand-drawn boxes: the figures that :class:`Errors` holds are printed. DIR holds pets2009/.
"""

import itertools
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks import options_of
from benchmarks.tracks import SAME_IOU, overlaps
from scene4d.core.people import Detections
from scene4d.evaluation import pets
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import write_camera
from scene4d.store.log import DetectionLog, Look
from scene4d.tracking import track

COVERED = 0.5
"""A box of which a nearer one covers more is hardly seen."""


@dataclass(frozen=True)
class Errors:
    """How a detector errs, at ten looks a second; measured on PETS S2L1 by this module.

    ``lost`` and ``stays_lost``: P(not detected), of what was detected in the look before and what
    was not, in the open and where more than :data:`COVERED` is covered. ``edge``: standard
    deviations of the left, upper, right and lower edge in widths and heights of the box, ``alike``
    their correlation from look to look, ``sides`` that of left and right. ``false``: how many
    wrong boxes begin in a look, as a share of the true ones, and ``false_stays`` P(again there).
    ``score``: mean and standard deviation. A person's width is that of arms and legs; all edges of
    ``vehicle`` err as a person's upper and lower ones, since PETS has none.
    """

    lost: tuple[float, float] = (0.009, 0.32)
    stays_lost: tuple[float, float] = (0.73, 0.68)
    edge: tuple[float, float, float, float] = (0.154, 0.041, 0.158, 0.041)
    vehicle: tuple[float, float, float, float] = (0.041, 0.041, 0.041, 0.041)
    alike: tuple[float, float, float, float] = (0.86, 0.79, 0.85, 0.73)
    sides: float = 0.42
    false: float = 0.008
    false_stays: float = 0.82
    score: tuple[float, float] = (0.83, 0.06)


ERRORS = Errors()


def share_covered(found: Detections) -> np.ndarray:
    """The largest share of each box that one nearer box of its frame covers."""
    out = np.zeros(len(found))
    order = np.argsort(found.frame, kind="stable")
    starts = np.flatnonzero(np.diff(found.frame[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        box = found.box_xyxy[rows]
        low = np.maximum(box[:, None, :2], box[None, :, :2])
        high = np.minimum(box[:, None, 2:], box[None, :, 2:])
        inside = np.clip(high - low, 0, None).prod(axis=2)
        nearer = box[None, :, 3] > box[:, None, 3]
        area = np.maximum((box[:, 2:] - box[:, :2]).prod(axis=1), 1e-9)
        out[rows] = np.where(nearer, inside, 0.0).max(axis=1) / area
    return out


class SimulatedDetector:
    """Looks of annotated boxes as a detector would give them, without track numbers: a function of
    looks that goes on with its random numbers from clip to clip.
    """

    def __init__(self, errors: Errors = ERRORS, seed: int = 0) -> None:
        self._errors = errors
        self._rng = np.random.default_rng(seed)

    def __call__(self, looks: Sequence[Look]) -> list[Look]:
        if not looks:
            return []
        true = Detections.concatenate([look.detections for look in looks])
        true = true.select(np.lexsort([true.frame, true.track]))
        found = Detections.concatenate([self._seen(true), *self._false(true, looks)])
        score = np.clip(self._rng.normal(*self._errors.score, len(found)), 0.3, 0.99)
        found = replace(found, track=np.full(len(found), -1), score=score)
        found = found.select(np.argsort(found.frame, kind="stable"))
        return [_part(look, found) for look in looks]

    def _seen(self, true: Detections) -> Detections:
        """Boxes of (track, frame) that are found, displaced; both go on from look to look."""
        e, rng = self._errors, self._rng
        covered = (share_covered(true) > COVERED).astype(int)
        error, luck = rng.standard_normal((len(true), 4)), rng.random(len(true))
        error[:, 2] = e.sides * error[:, 0] + np.sqrt(1 - e.sides**2) * error[:, 2]
        alike, kept = np.array(e.alike), np.zeros(len(true), bool)
        for row in range(len(true)):
            again = row > 0 and true.track[row] == true.track[row - 1]
            if again:
                error[row] = alike * error[row - 1] + np.sqrt(1 - alike**2) * error[row]
            missed = again and not kept[row - 1]
            kept[row] = luck[row] >= (e.stays_lost if missed else e.lost)[covered[row]]
        person = (true.class_name == "person")[:, None]
        size = np.tile(true.box_xyxy[:, 2:] - true.box_xyxy[:, :2], 2)
        box = true.box_xyxy + error * np.where(person, e.edge, e.vehicle) * size
        return replace(true, box_xyxy=_whole(box)).select(kept)

    def _false(self, true: Detections, looks: Sequence[Look]) -> list[Detections]:
        """Boxes half as large beside true ones, which stay where they are for a while."""
        e, rng = self._errors, self._rng
        frames = np.concatenate([look.frame for look in looks])
        times = np.concatenate([look.time_s for look in looks])
        out = []
        for row in np.flatnonzero(rng.random(len(true)) < e.false):
            first = int(np.searchsorted(frames, true.frame[row]))
            last = min(first + int(rng.geometric(1 - e.false_stays)), len(frames))
            at = np.arange(first, last)
            x1, y1, x2, y2 = true.box_xyxy[row]
            shift = np.tile(rng.uniform(-1, 1, 2) * (x2 - x1, y2 - y1), 2)
            box = np.array([x1, y1, (x1 + x2) / 2, (y1 + y2) / 2]) + shift
            box = _whole(box + rng.normal(0, 1, (len(at), 4)))
            one = true.select(np.full(len(at), row))
            out.append(replace(one, frame=frames[at], time_s=times[at], box_xyxy=box))
        return out


def _whole(box: np.ndarray) -> np.ndarray:
    """Boxes that are two pixels large at least."""
    return np.hstack([box[:, :2], np.maximum(box[:, 2:], box[:, :2] + 2.0)])


def _part(look: Look, everything: Detections) -> Look:
    if not len(look.frame):
        return look
    begin = np.searchsorted(everything.frame, look.frame[0])
    end = np.searchsorted(everything.frame, look.frame[-1], side="right")
    return Look(look.frame, look.time_s, everything.select(np.arange(begin, end)))


def measured(truth: Detections, looks: Sequence[Look]) -> None:
    """Print the figures of :class:`Errors`."""
    frames = np.concatenate([look.frame for look in looks])
    found = Detections.concatenate([look.detections for look in looks])
    found = found.select(found.class_name == "person")
    truth = truth.select(np.isin(truth.frame, frames))
    error, score = np.full((len(truth), 4), np.nan), np.full(len(truth), np.nan)
    wrong = []
    for frame in frames:
        rows, there = (np.flatnonzero(one.frame == frame) for one in (truth, found))
        iou = overlaps(truth.box_xyxy[rows], found.box_xyxy[there])
        i, j = linear_sum_assignment(-iou)
        good = iou[i, j] > SAME_IOU
        rows, mine = rows[i[good]], there[j[good]]
        size = np.tile(truth.box_xyxy[rows, 2:] - truth.box_xyxy[rows, :2], 2)
        error[rows] = (found.box_xyxy[mine] - truth.box_xyxy[rows]) / size
        score[rows] = found.score[mine]
        wrong.append(found.box_xyxy[np.setdiff1d(there, mine)])
    order = np.lexsort([truth.frame, truth.track])
    truth, error, score = truth.select(order), error[order], score[order]
    seen, hidden = np.isfinite(score), share_covered(truth) > COVERED
    pair = np.diff(truth.track) == 0
    for name, which in (("open", ~hidden), ("covered", hidden)):
        rows = pair & which[1:]
        lost, stays = (1 - seen[1:][rows & (seen[:-1] == was)].mean() for was in (True, False))
        print(f"{name}: {int(rows.sum())} looks, lost {lost:.3f}, stays lost {stays:.2f}")
    there = seen & ~hidden
    both = pair & there[1:] & there[:-1]
    alike = [np.corrcoef(error[1:][both, k], error[:-1][both, k])[0, 1] for k in range(4)]
    print("edge", error[there].std(axis=0).round(3), "mean", error[there].mean(axis=0).round(3))
    print("alike", np.round(alike, 2), "sides", np.corrcoef(error[there].T)[0, 2].round(2))
    print("score", score[there].mean().round(2), score[there].std().round(2))
    again = [overlaps(a, b).max(axis=0, initial=0) > SAME_IOU for a, b in itertools.pairwise(wrong)]
    stays = np.concatenate(again)
    begun = (~stays).sum() / len(truth)
    count = sum(map(len, wrong[:-1]))
    print(f"false: {begun:.4f} begin, as a share of true ones; stays {stays.sum() / count:.2f}")


def main() -> None:
    parser = options_of(__doc__)
    data = parser.parse_args().data / "pets2009"
    reference = pets(data)
    truth = read_annotations(data / "PETS2009-S2L1.xml", image_size=reference.image_size)
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch)
        write_camera(reference.camera, out / "true.json", "json")
        track(data / "vtest.avi", out / "true.json", out / "scene")
        (log,) = (out / "scene" / "detections").iterdir()
        looks = looks_in(log)
    measured(truth, looks)


def looks_in(folder: Path) -> list[Look]:
    """Everything that a log holds."""
    settings = json.loads((folder / "settings.json").read_text())["settings"]
    return list(DetectionLog(folder, settings).chunks())


if __name__ == "__main__":
    main()
