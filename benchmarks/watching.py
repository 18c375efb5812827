"""Whether ``watch`` keeps up, and its memory: python -m benchmarks.watching

    [--data DIR] [--footage CLIP...] [--cameras 8] [--rate 2] [--minutes 5] [--hours 1]

Each clip is played again and again (by default a street with people and vehicles). First as so many
cameras at real time, in one process on all cores, or on those that ``taskset`` leaves it: how many
frames were dropped, and how much processor time a camera took for a second of which all frames were
analysed, decoding included. Then as one camera for hours, as fast as it goes, where the
networks say what they said the first time: memory at the beginning, in the middle and at the end.
"""

import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np

from benchmarks import options_of
from benchmarks.tables import Rows, machine, markdown
from scene4d.perception.objects import ObjectDetector
from scene4d.tracking import TrackOptions, watch, watch_several
from scene4d.video.frames import Frame
from scene4d.video.live import LiveSource

CLIP = "footage/streets/plaza_960x540_14s.mp4"
SEARCHES = ("person enters vehicle", "two people meet")


def memory_mb() -> float:
    """Resident memory of this process (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def looped(clip: Path, seconds: float, out: Path) -> Path:
    """The clip again and again, as it is encoded."""
    with av.open(str(out), "w") as target:
        copy, offset, length = None, 0, 0
        while True:
            with av.open(str(clip)) as source:
                stream = source.streams.video[0]
                copy = copy or target.add_stream_from_template(stream)
                for packet in source.demux(stream):
                    if packet.dts is None:
                        continue
                    length = max(length, packet.pts + packet.duration)
                    packet.pts, packet.dts = packet.pts + offset, packet.dts + offset
                    packet.stream = copy
                    target.mux(packet)
                offset += length
                if offset * stream.time_base >= seconds:
                    return out


def cameras_at_once(clip: Path, camera: Path, asked, scratch: Path) -> Rows:
    """All cameras at real time."""
    video = looped(clip, 60 * asked.minutes, scratch / "looped.mp4")
    names = [f"gate-{number}" for number in range(asked.cameras)]
    memory, stop = [], threading.Event()

    def measure() -> None:
        while not stop.wait(10):
            memory.append(memory_mb())

    threading.Thread(target=measure, daemon=True).start()
    begun_s, processor_s = time.monotonic(), time.process_time()
    runs = watch_several(
        [video] * asked.cameras,
        [camera] * asked.cameras,
        scratch / "scene",
        tracking=TrackOptions(rate_hz=asked.rate),
        names=names,
        searches=SEARCHES,
    )
    stop.set()
    took_s, processor_s = time.monotonic() - begun_s, time.process_time() - processor_s
    offered, dropped = (sum(getattr(run, n) for run in runs) for n in ("offered", "dropped"))
    third = len(memory) // 3
    parts = [np.mean(memory[k * third : (k + 1) * third]) for k in range(3)]
    return [
        ["footage", "cameras", "rate", "frames", "dropped", "cores",
         "processor time per camera and second", "memory: 1st third", "2nd", "3rd"],
        [clip.stem, str(asked.cameras), f"{asked.rate:g} Hz", str(offered),
         f"{dropped / offered:.1%}", f"{processor_s / took_s:.2f}",
         f"{processor_s * asked.rate / (offered - dropped):.2f} s",
         *(f"{mb:.0f} MB" for mb in parts)],
    ]  # fmt: skip


class Fast(LiveSource):
    """Frames of a clip, again and again, as soon as they are asked for."""

    pictures: list[np.ndarray]
    seconds: float

    def __init__(self, source, rate_hz, *, give_up_s=None):
        super().__init__(source, rate_hz)
        self._index = 0

    def start(self):
        self.began = datetime.now(UTC)

    @property
    def now_s(self):
        return self.taken_s

    def take(self, timeout_s):
        self.taken_s = self._index / self._rate_hz
        if self.taken_s >= self.seconds:
            self.stop()
            return None
        self._index += 1
        self.offered += 1
        image = self.pictures[(self._index - 1) % len(self.pictures)]
        return Frame(self._index - 1, self.taken_s, image)


class Again:
    """What the networks said of the same picture the first time."""

    def __init__(self, found: ObjectDetector, pictures: int) -> None:
        self._found, self._pictures, self._said = found, pictures, {}
        self.timings = found.timings

    def begin(self) -> None:
        self._found.begin()

    def look(self, frame):
        number = frame.index % self._pictures
        if number not in self._said:
            self._said[number] = self._found.look(frame)
        seen, colours = self._said[number]
        index, time_s = np.full(len(seen), frame.index), np.full(len(seen), frame.time_s)
        return replace(seen, frame=index, time_s=time_s), colours


def hours(clip: Path, camera: Path, asked, scratch: Path) -> Rows:
    """One camera for long."""
    from scene4d.tracking import watching
    from scene4d.video import live

    with av.open(str(clip)) as source:
        step = round(float(source.streams.video[0].average_rate) / asked.rate)
        frames = (f for k, f in enumerate(source.decode(video=0)) if k % step == 0)
        Fast.pictures = [frame.to_ndarray(format="bgr24") for frame in frames]
    Fast.seconds = 3600 * asked.hours
    plain, detectors = live.LiveSource, watching.detectors
    live.LiveSource = Fast
    watching.detectors = lambda job: Again(detectors(job), len(Fast.pictures))
    memory: list[float] = []
    stop = threading.Event()
    begun_s = time.monotonic()

    def measure() -> None:
        while not stop.wait(1):
            memory.append(memory_mb())

    threading.Thread(target=measure, daemon=True).start()
    try:
        run = watch(
            clip, camera, scratch / "long", searches=SEARCHES,
            tracking=TrackOptions(rate_hz=asked.rate),
        )  # fmt: skip
    finally:
        stop.set()
        live.LiveSource, watching.detectors = plain, detectors
    took_s = time.monotonic() - begun_s
    shown = [f"{memory[int(share * len(memory))]:.0f} MB" for share in (0.1, 0.5, 0.95)]
    print({name: round(seconds, 1) for name, seconds in run.timings.items()})
    return [
        ["hours", "frames", "took", "rows", "memory: at a tenth",
         "in the middle", "at the end", "most"],
        [f"{asked.hours:g}", str(run.offered), f"{took_s:.0f} s", str(run.rows), *shown,
         f"{max(memory):.0f} MB"],
    ]  # fmt: skip


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--footage", nargs="+", default=[CLIP], help="below --data")
    parser.add_argument("--cameras", type=int, default=8)
    parser.add_argument("--rate", type=float, default=2.0)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--hours", type=float, default=1.0)
    asked = parser.parse_args()
    print(machine())
    for clip in (asked.data / name for name in asked.footage):
        with tempfile.TemporaryDirectory() as scratch:
            camera = Path(scratch) / "camera" / "camera.json"
            # In a process of its own: its memory is not that of watch.
            calibrating = [sys.executable, "-m", "scene4d", "calibrate", str(clip), "-q", "--out"]
            subprocess.run([*calibrating, str(camera.parent)], check=True)
            if asked.minutes:
                found = cameras_at_once(clip, camera, asked, Path(scratch))
                print(f"\n{markdown(found)}", flush=True)
            if asked.hours:
                print(f"\n{markdown(hours(clip, camera, asked, Path(scratch)))}", flush=True)


if __name__ == "__main__":
    main()
