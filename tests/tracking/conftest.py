"""A detector that knows the answer, and the camera's file."""

from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from scene4d.perception.objects import ObjectDetector
from scene4d.video.frames import Frame
from scene4d.video.live import LiveSource
from walks import CAMERA, FPS, SECONDS, detections, ground


class Perfect:
    """A detector that knows the answer; it stops working after some frames."""

    def __init__(self, until: int | None = None) -> None:
        self.timings = {"detect people": 0.0}
        self.seen: list[int] = []
        self.until = until

    def expecting(self, _):
        return self

    def attentive(self):
        return self

    def begin(self):
        pass

    def look(self, frame):
        if self.until is not None and frame.index >= self.until:
            raise KeyboardInterrupt
        self.seen.append(frame.index)
        found = detections(frame.index % (FPS * SECONDS))  # who leaves the picture comes again
        n = len(found)
        found = replace(found, frame=np.full(n, frame.index), time_s=np.full(n, frame.time_s))
        # Everybody is in red and dark blue.
        readings = np.tile(np.float32([44, 50, 25, 1, 20, 4, -20, 1]), (n, 1))
        return found, np.full((n, 4), 0.25, np.float32), readings

    def looks(self, frames):
        return ((frame.index, frame.time_s, *self.look(frame)) for frame in frames)


def play_paced(live: LiveSource, source) -> None:
    """A camera that waits for whoever looks: each frame comes when the one before was taken. So
    none is dropped, however busy the machine is, and nobody waits for a clock.
    """
    for frame in source.frames():
        while live._newest is not None and not live._stopping.wait(0.001):
            pass
        if live._stopping.is_set():
            return
        live._offer(frame)


class Endless:
    """Footage of the empty ground that does not end."""

    @staticmethod
    def frames():
        return (Frame(index, index / FPS, ground()) for index in count())


def play_endless(live: LiveSource, source) -> None:
    """The same of footage that does not end."""
    play_paced(live, Endless)


@pytest.fixture
def drawn() -> None:
    """For tests of the pictures of a scene."""


@pytest.fixture(autouse=True)
def plain_scene(request, monkeypatch) -> None:
    """Scenes without pictures, which take half of the time, where they are not the matter."""
    if "drawn" not in request.fixturenames:
        for name in ("_drawn", "_drawn_objects"):
            monkeypatch.setattr(f"scene4d.tracking._running.{name}", lambda *_: None)


@pytest.fixture
def paced(monkeypatch):
    monkeypatch.setattr(LiveSource, "_play", play_paced)


@pytest.fixture
def endless(monkeypatch):
    monkeypatch.setattr(LiveSource, "_play", play_endless)


@pytest.fixture
def detector(monkeypatch):
    def use(until: int | None = None) -> Perfect:
        made = Perfect(until)
        monkeypatch.setattr(ObjectDetector, "default", lambda **_: made)
        monkeypatch.setattr("scene4d.calibration.watching.fetch_weights", lambda *_, **__: None)
        return made

    return use


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    path = tmp_path / "camera" / "camera.json"
    path.parent.mkdir()
    CAMERA.save(path)
    return path
