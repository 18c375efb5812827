"""How time and memory grow: people in the solver, frames, image size, pairs of P(near)."""

import statistics
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.scenes import CAMERAS, draw_people
from benchmarks.tables import Rows
from scene4d import solve_camera
from scene4d.evaluation.measures._near import near_pairs
from scene4d.perception.detectors.tiles import choose_tiles
from scene4d.perception.detectors.yolox import YoloxDetector
from scene4d.perception.keypoints import KeypointEstimator
from scene4d.perception.people import PeopleDetector, detect_people
from scene4d.video.reader import open_source
from scene4d.video.sampling import sample_frames

CAMERA = CAMERAS[0]
PLACES = 12
TRUNCATED = 0.1


@dataclass(frozen=True)
class Curve:
    """``y`` by amount of work ``x``, both for log axes."""

    title: str
    x_label: str
    y_label: str
    x: list[float]
    y: list[float]


def median_seconds(call: Callable[[], object], repeats: int) -> float:
    seconds = []
    for _ in range(repeats):
        begun = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begun)
    return statistics.median(seconds)


def peak_mb(call: Callable[[], object]) -> float:
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return peak


def people(counts: Sequence[int]) -> tuple[Rows, list[Curve]]:
    """``solve_camera`` by number of people, one in ten of them truncated."""
    seconds, memory = [], []
    for n in counts:
        feet, heads, _ = draw_people(CAMERA, n, np.random.default_rng(0), TRUNCATED)
        call = lambda f=feet, h=heads: solve_camera(f, h, image_size=CAMERA.image_size)  # noqa: E731
        call()
        seconds.append(median_seconds(call, 9 if n <= 10_000 else 3 if n <= 100_000 else 1))
        memory.append(peak_mb(call))
    rows = [["people", "time", "per person", "peak memory"]]
    for n, s, mb in zip(counts, seconds, memory, strict=True):
        rows.append([f"{n:,}", shown(s), f"{1e6 * s / n:.1f} µs", f"{mb:,.1f} MB"])
    x = [float(n) for n in counts]
    return rows, [
        Curve("solve_camera: time", "people", "s", x, seconds),
        Curve("solve_camera: memory", "people", "MB", x, memory),
    ]


def frames(video: Path, counts: Sequence[int]) -> tuple[Rows, list[Curve]]:
    """Decoding, detector, keypoints and tracker by number of sampled frames."""
    detector, keypoints = YoloxDetector(), KeypointEstimator()
    rows, seconds = [["frames", "people seen", "time", "per frame"]], []
    for n in counts:
        begun = time.perf_counter()
        with open_source(video) as source:
            found = detect_people(sample_frames(source, n), PeopleDetector(detector, keypoints))
        seconds.append(time.perf_counter() - begun)
        per_frame = f"{1e3 * seconds[-1] / n:.0f} ms"
        rows.append([f"{n}", f"{len(found):,}", shown(seconds[-1]), per_frame])
    x = [float(n) for n in counts]
    return rows, [Curve("watching the sample video", "frames", "s", x, seconds)]


def sizes(video: Path, widths: Sequence[int], count: int) -> tuple[Rows, list[Curve]]:
    """Detector and keypoints per frame of the sample video, enlarged or shrunk."""
    detector, keypoints = YoloxDetector(), KeypointEstimator()
    with open_source(video) as source:
        pictures = [frame.image_bgr for frame in sample_frames(source, count)]
    height, width = pictures[0].shape[:2]
    rows = [["image", "passes of the detector", "people", "detect", "keypoints"]]
    pixels, detect, pose = [], [], []
    for wide in widths:
        size = (wide, round(height * wide / width))
        scaled = [cv2.resize(picture, size) for picture in pictures]
        detector.detect(scaled[0])
        begun = time.perf_counter()
        boxes = [np.asarray(detector.detect(picture).xyxy, float) for picture in scaled]
        middle = time.perf_counter()
        for picture, box in zip(scaled, boxes, strict=True):
            keypoints.estimate(picture, box)
        detect.append((middle - begun) / count)
        pose.append((time.perf_counter() - middle) / count)
        pixels.append(float(size[0] * size[1]))
        many = f"{np.mean([len(box) for box in boxes]):.1f}"
        passes = 1 + len(choose_tiles(size))
        rows.append([f"{size[0]}x{size[1]}", f"{passes}", many, shown(detect[-1]), shown(pose[-1])])
    return rows, [
        Curve("detector, per frame", "pixels", "s", pixels, detect),
        Curve("keypoints, per frame", "pixels", "s", pixels, pose),
    ]


def pairs(counts: Sequence[int]) -> tuple[Rows, list[Curve]]:
    """P(near) of people and 12 places, with the spread of every distance."""
    feet, heads, xy = draw_people(CAMERA, max(*counts, 400), np.random.default_rng(0))
    found = solve_camera(feet[:400], heads[:400], image_size=CAMERA.image_size)
    places, places_xy = feet[:PLACES], xy[:PLACES]
    rows, seconds = [["people", "pairs", "time"]], []
    for n in counts:
        pairs = np.indices((n, PLACES)).reshape(2, -1).T
        apart = np.linalg.norm(xy[pairs[:, 0]] - places_xy[pairs[:, 1]], axis=1)

        def expected(n: int = n, pairs: np.ndarray = pairs, apart: np.ndarray = apart) -> object:
            return near_pairs(found, feet[:n], places, pairs, apart).readings()["expected"]

        expected()
        seconds.append(median_seconds(expected, 5))
        rows.append([f"{n:,}", f"{n * PLACES:,}", shown(seconds[-1])])
    return rows, [
        Curve("P(near) with 12 places", "people", "s", [float(n) for n in counts], seconds)
    ]


def shown(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"
