"""Where the time of a calibration goes, and what of it is the networks' and the decoder's own.

Nothing in the package is changed: its functions are wrapped by a clock while one calibration runs.
"""

import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import av
import numpy as np

from benchmarks.tables import Rows
from scene4d.calibration.calibrating import Run, run
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.writing import write
from scene4d.core.progress import Silent
from scene4d.perception import objects as objects_module
from scene4d.perception._session import open_coarse
from scene4d.perception._tracking import Tracker
from scene4d.perception.detectors.yolox import YoloxDetector
from scene4d.perception.keypoints import BATCH, INPUT_SIZE, KeypointEstimator
from scene4d.perception.people import PeopleDetector
from scene4d.perception.weights import weight_path
from scene4d.video import sampling
from scene4d.video.background import Background
from scene4d.video.motion import MotionMonitor
from scene4d.video.reader import open_source

WRAPPED = {
    "load the networks": [(PeopleDetector, "default")],
    "detect": [(YoloxDetector, "detect")],
    "keypoints": [(KeypointEstimator, "estimate")],
    "track": [(Tracker, "update"), (objects_module, "colour_histograms")],
    "does it move, background": [
        (MotionMonitor, "add"),
        (MotionMonitor, "verdict"),
        (Background, "add"),
        (Background, "image"),
    ],
}
OWN_CLOCK = {"edges": "straight edges", "solve": "solve", "report": "report"}
"""Stages of which the pipeline itself keeps the time."""


@dataclass(frozen=True, eq=False)
class Timed:
    """One calibration: seconds by stage, and how many people each frame had."""

    result: Run
    seconds: dict[str, float]
    people: list[int]
    total_s: float


class Clock:
    """Adds up the seconds inside wrapped functions."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    def on(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **named: Any) -> Any:
            begun = time.perf_counter()
            try:
                return function(*args, **named)
            finally:
                self.seconds[name] += time.perf_counter() - begun

        return timed

    def over(self, name: str, function: Callable[..., Iterator[Any]]) -> Callable[..., Any]:
        """As :meth:`on`, for a generator: the time until each next item."""

        def timed(*args: Any, **named: Any) -> Iterator[Any]:
            following = self.on(name, function(*args, **named).__next__)
            while True:
                try:
                    item = following()
                except StopIteration:
                    return
                yield item

        return timed


def timed_calibration(video: Path, frames: int | None) -> Timed:
    """``scene4d calibrate`` of the video, with its report, under the clock."""
    clock, people = Clock(), []
    estimate = KeypointEstimator.estimate

    def counting(self: Any, image: Any, box: Any) -> Any:
        people.append(len(box))
        return estimate(self, image, box)

    with ExitStack() as stack:
        out = stack.enter_context(tempfile.TemporaryDirectory())
        stack.enter_context(mock.patch.object(KeypointEstimator, "estimate", counting))
        reading = clock.over("decode", sampling.sample_frames)
        stack.enter_context(mock.patch.object(sampling, "sample_frames", reading))
        for name, places in WRAPPED.items():
            for owner, attribute in places:
                wrapped = clock.on(name, getattr(owner, attribute))
                stack.enter_context(mock.patch.object(owner, attribute, wrapped))
        begun = time.perf_counter()
        result = run(video, CalibrateOptions(frames=frames), Silent())
        write(result, out, progress=Silent())
        total = time.perf_counter() - begun
    for theirs, name in OWN_CLOCK.items():
        clock.seconds[name] = result.timings[theirs]
    return Timed(result, dict(clock.seconds), people, total)


def decode_sampled(video: Path, frames: int | None) -> float:
    """The same frames, and nothing done with them."""
    begun = time.perf_counter()
    with open_source(video) as source:
        for _ in sampling.sample_frames(source, frames):
            pass
    return time.perf_counter() - begun


def decode_all(video: Path) -> float:
    """Every frame of the file from front to end, bare PyAV, no conversion to BGR."""
    begun = time.perf_counter()
    with av.open(str(video)) as container:
        container.streams.video[0].thread_type = "AUTO"
        for _ in container.decode(video=0):
            pass
    return time.perf_counter() - begun


def bare_detector(video: Path, passes: int) -> float:
    """The detector's network alone, on a prepared input of the size that the video needs."""
    detector = YoloxDetector()
    with open_source(video) as source:
        detector.detect(next(iter(source.frames())).image_bgr)
    ((columns, rows), session), *_ = detector._sessions.items()
    blob = np.full((1, 3, rows, columns), 114.0, np.float32)
    return _passes(session, [blob] * passes)


def bare_keypoints(people: list[int]) -> float:
    """The keypoint network alone, in the same batches."""
    session = open_coarse(weight_path("rtmpose-s"))
    width, height = INPUT_SIZE
    crops = np.zeros((BATCH, 3, height, width), np.float32)
    sizes = [min(BATCH, n - start) for n in people for start in range(0, n, BATCH)]
    return _passes(session, [crops[:size] for size in sizes])


def _passes(session: Any, blobs: list[np.ndarray]) -> float:
    session.run(None, {"input": blobs[0]})
    begun = time.perf_counter()
    for blob in blobs:
        session.run(None, {"input": blob})
    return time.perf_counter() - begun


def table(timed: Timed, video: Path, frames: int | None) -> Rows:
    """Stages in order, each beside its limit where it has one."""
    n, people = len(timed.people), sum(timed.people)
    limits = {
        "decode": (f"the same {n} frames, decoded and dropped", decode_sampled(video, frames)),
        "detect": (f"{n} bare passes of its network", bare_detector(video, n)),
        "keypoints": (
            f"bare passes of its network, {people:,} people in the same batches",
            bare_keypoints(timed.people),
        ),
    }
    rows = [["stage", "s", "share", "limit", "s", "stage / limit"]]
    named = ["load the networks", "decode", "detect", "keypoints", "track",
             "does it move, background", *OWN_CLOCK.values()]  # fmt: skip
    seconds = {name: timed.seconds[name] for name in named}
    seconds["all the rest"] = timed.total_s - sum(seconds.values())
    for name, took in seconds.items():
        what, least = limits.get(name, ("", 0.0))
        limit = [what, f"{least:.2f}", f"{took / least:.2f}"] if what else ["", "", ""]
        rows.append([name, f"{took:.2f}", f"{took / timed.total_s:.0%}", *limit])
    everything = f"all {_frame_count(video)} frames decoded front to end"
    rows.append(
        ["**all**", f"**{timed.total_s:.2f}**", "", everything, f"{decode_all(video):.2f}", ""]
    )
    return rows


def _frame_count(video: Path) -> int:
    with open_source(video) as source:
        return source.frame_count or 0
