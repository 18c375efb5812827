"""Colours of clothes and vehicles against what a person says who looks at the pictures.

    python -m benchmarks.colours [--footage DIR] [--sheets DIR]

DIR of --footage holds the clips of benchmarks/colours_by_eye.csv (by default
$SCENE4D_DATA/footage or ../shared/data/footage). What the "first" group showed was known when the
constants were chosen; the one that is "held out" was named and read after that, and has served for
one choice since (docs/colours.md). --sheets writes pictures of tracks without any answer, for
naming more of them.
"""

import argparse
import csv
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks import DATA
from benchmarks.tables import markdown
from scene4d.core.boxes import iou
from scene4d.core.colours import NAMES, PARTS, colour_probability
from scene4d.core.people import Detections
from scene4d.perception._tracking import Tracker
from scene4d.perception.objects import ObjectDetector
from scene4d.perception.vehicles import VehicleTracker
from scene4d.tracking._colours import Colours
from scene4d.video.reader import open_source

BY_EYE = Path(__file__).with_name("colours_by_eye.csv")
RATE_HZ, LONGEST_S, LEAST_S = 5.0, 14.0, 1.5
SHEET_PX, PICTURES, LEAST_PX = 150, 3, 30.0
VEHICLES = ("car", "truck", "bus", "vehicle")


@dataclass(frozen=True)
class Seen:
    """One track of a clip: its moments, boxes and pictures, and the answer."""

    name: str
    time_s: np.ndarray
    box: np.ndarray
    pictures: list[np.ndarray]
    colours: np.ndarray


def tracks_of(video: Path) -> list[Seen]:
    """Everybody who is in view for long enough, in the first seconds of a clip."""
    objects, colours = ObjectDetector.default().attentive(), Colours()
    trackers = {"person": Tracker(), "vehicle": VehicleTracker()}
    rows: dict[int, list[tuple[float, np.ndarray, str]]] = defaultdict(list)
    pictures: dict[int, list[tuple[float, np.ndarray]]] = defaultdict(list)
    with open_source(video) as footage:
        assert footage.timeline is not None
        times = footage.timeline.time_s
        slot = np.floor(times[times < LONGEST_S] * RATE_HZ + 1e-6)
        indices = np.flatnonzero(np.diff(slot, prepend=-1) > 0).tolist()
        for frame in footage.frames(indices):
            found, histograms, readings = objects.look(frame)
            number = _numbered(found, histograms, frame.time_s, trackers)
            known = number >= 0
            colours.add(found.select(known), number[known], readings[known].astype(float))
            for row in np.flatnonzero(known).tolist():
                box, track = found.box_xyxy[row], int(number[row])
                rows[track].append((frame.time_s, box, str(found.class_name[row])))
                pictures[track].append((_worth(box, found), _crop(frame.image_bgr, box)))
    long = [t for t, told in rows.items() if told[-1][0] - told[0][0] >= LEAST_S]
    return [_seen(t, rows[t], pictures[t], colours) for t in sorted(long)]


def _numbered(
    found: Detections, histograms: np.ndarray, time_s: float, trackers: dict
) -> np.ndarray:
    """Track numbers, even ones of people and odd ones of vehicles; -1 for what is left out."""
    number = np.full(len(found), -1)
    people = found.class_name == "person"
    vehicles = np.isin(found.class_name, VEHICLES)
    own = trackers["person"].update(found.box_xyxy[people], time_s, histograms[people])
    number[people] = np.where(own < 0, -1, 2 * own)
    number[vehicles] = 2 * trackers["vehicle"].update(found.box_xyxy[vehicles], time_s) + 1
    return number


def _worth(box: np.ndarray, found: Detections) -> float:
    """The larger and the less hidden the better to look at."""
    others = found.box_xyxy[(found.box_xyxy != box).any(axis=1)]
    hidden = iou(box, others).max() if len(others) else 0.0
    return float((box[3] - box[1]) * (1 - hidden))


def _crop(image: np.ndarray, box: np.ndarray) -> np.ndarray:
    margin = 0.1 * (box[3] - box[1])
    x1, y1 = np.maximum(box[:2] - margin, 0).astype(int)
    x2, y2 = (box[2:] + margin).astype(int)
    part = image[y1:y2, x1:x2]
    width = max(1, round(part.shape[1] * SHEET_PX / max(part.shape[0], 1)))
    return cv2.resize(part, (min(width, 2 * SHEET_PX), SHEET_PX), interpolation=cv2.INTER_CUBIC)


def _seen(track: int, rows: list, pictures: list, colours: Colours) -> Seen:
    best = sorted(pictures, key=lambda one: -one[0])[: 2 * PICTURES : 2]
    time_s, box, kinds = (np.array(column) for column in zip(*rows, strict=True))
    name = max(set(kinds.tolist()), key=kinds.tolist().count)
    told = colours.of(np.array([track]), np.array([name]))[0]
    return Seen(name, time_s, box, [picture for _, picture in best], told)


def write_sheet(path: Path, seen: list[Seen]) -> None:
    """Pictures of each track beside its place in the list, without the answer."""
    lines = []
    for number, one in enumerate(seen):
        line = np.full((SHEET_PX + 4, 620, 3), 255, np.uint8)
        x = 70
        for picture in one.pictures:
            width = min(picture.shape[1], 175)
            line[:SHEET_PX, x : x + width] = picture[:, :width]
            x += width + 6
        for row, text in enumerate((str(number), one.name)):
            place = (4, 30 + 25 * row)
            cv2.putText(line, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1)
        lines.append(line)
    lines += [np.full_like(lines[0], 255)] * (-len(lines) % 2)
    both = np.hstack([np.vstack(lines[::2]), np.vstack(lines[1::2])])
    cv2.imwrite(str(path), both)


def places(seen: list[Seen], clip: str) -> list[dict[str, str]]:
    """Lines of the list of what is seen by eye, still without names."""
    lines = []
    for one in seen:
        at = len(one.time_s) // 2
        box = " ".join(str(round(v)) for v in one.box[at])
        line = {"clip": clip, "time_s": f"{one.time_s[at]:.2f}", "box": box, "class": one.name}
        lines.append(line | dict.fromkeys(PARTS, ""))
    return lines


def named(seen: list[Seen], line: dict[str, str]) -> Seen | None:
    """The track that a line of the list speaks of."""
    box = np.array(line["box"].split(), float)
    for one in seen:
        at = int(np.abs(one.time_s - float(line["time_s"])).argmin())
        near = abs(one.time_s[at] - float(line["time_s"])) < 0.5 / RATE_HZ
        if near and iou(box, one.box[at]) > 0.6:
            return one
    return None


def answers(lines: list[dict[str, str]], footage: Path) -> list[dict]:
    """For each part of a named track what was said by eye, and the probability of each name."""
    found = []
    for clip in dict.fromkeys(line["clip"] for line in lines):
        seen = tracks_of(footage / clip)
        for line in (line for line in lines if line["clip"] == clip):
            one = named(seen, line)
            for number, part in enumerate(PARTS):
                if not line[part] or one is None:
                    continue
                half = np.split(one.colours, len(PARTS))[number]
                person = np.array([line["class"] == "person"])
                chances = [
                    colour_probability(one.colours[None], name, part, person)[0] for name in NAMES
                ]
                told = {"line": line, "part": part, "said": line[part].split("/")}
                found.append(told | {"read": half.sum() > 0, "p": np.array(chances)})
    return found


def report(found: list[dict]) -> str:
    """Tables: each track, and how often what has a probability is so."""
    rows = []
    for one in found:
        order = np.argsort(-one["p"])[:2]
        said = ", ".join(f"{NAMES[k]} {one['p'][k]:.2f}" for k in order) if one["read"] else "-"
        clip = Path(one["line"]["clip"]).stem
        at = f"{one['line']['time_s']} s"
        right = one["read"] and NAMES[int(order[0])] in one["said"]
        verdict = "yes" if right else "no" if one["read"] else ""
        eye = " or ".join(one["said"])
        rows.append([clip, at, one["line"]["class"], one["part"], eye, said, verdict])
    read = [one for one in found if one["read"]]
    text = markdown([["clip", "at", "class", "part", "by eye", "scene4d", "right"], *rows])
    right = sum(row[-1] == "yes" for row in rows)
    text += f"\n\n{len(read)} of {len(found)} parts are read; the likeliest name is right in "
    text += f"{right} ({right / max(len(read), 1):.0%}).\n\n"
    p = np.concatenate([one["p"] for one in read])
    # Where the eye is torn between two names each is half true.
    so = np.concatenate([np.isin(NAMES, one["said"]) / len(one["said"]) for one in read])
    bands = ((0, 0.05), (0.05, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.01))
    table, error = [], 0.0
    for low, high in bands:
        inside = (p >= low) & (p < high)
        if inside.any():
            error += inside.sum() * abs(p[inside].mean() - so[inside].mean())
            share = f"{p[inside].mean():.2f}", f"{so[inside].mean():.2f}"
            table.append([f"{low:g} to {min(high, 1):g}", str(inside.sum()), *share])
    text += markdown([["probability", "names", "mean", "so by eye"], *table])
    return f"{text}\n\nExpected calibration error {error / len(p):.3f}.\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--footage", type=Path, default=DATA / "footage")
    parser.add_argument("--sheets", type=Path)
    parser.add_argument("clips", nargs="*")
    asked = parser.parse_args()
    if asked.sheets is None:
        with BY_EYE.open() as file:
            lines = list(csv.DictReader(file))
        for group in dict.fromkeys(line["group"] for line in lines):
            some = [line for line in lines if line["group"] == group]
            print(f"## {group}\n\n{report(answers(some, asked.footage))}")
        return
    asked.sheets.mkdir(parents=True, exist_ok=True)
    for clip in asked.clips:
        tall = [
            one
            for one in tracks_of(asked.footage / clip)
            if np.median(one.box[:, 3] - one.box[:, 1]) >= LEAST_PX
        ]
        write_sheet(asked.sheets / f"{Path(clip).stem}.png", tall)
        with (asked.sheets / f"{Path(clip).stem}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, ("clip", "time_s", "box", "class", *PARTS, "group"))
            writer.writeheader()
            writer.writerows(places(tall, clip))


if __name__ == "__main__":
    main()
