"""A camera, people and a car that go their ways in front of it, and footage of the empty ground."""

from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.people import Detections

SIZE, FPS, SECONDS = (640, 480), 10, 8
CAMERA = Camera.from_pose(
    image_size=SIZE, focal_px=600.0, tilt_rad=0.35, roll_rad=0.01, height_m=5.0
)
STARTS = np.array([[-3.0, 10.0], [2.5, 14.0]])
VELOCITIES = np.array([[0.9, 0.4], [-0.6, -0.5]])
CAR = np.array([0.5, 20.0])


def places(time_s):
    """Where the two people are (2, 2)."""
    return STARTS + VELOCITIES * time_s


def person_box(xy):
    """The box around an upright cylinder with a head, through the camera."""
    turn = np.linspace(0, 2 * np.pi, 24)
    rim = np.column_stack([xy[0] + 0.25 * np.cos(turn), xy[1] + 0.25 * np.sin(turn)])
    body = np.vstack([np.column_stack([rim, np.full(24, z)]) for z in (0.0, 1.0)])
    uv = CAMERA.project(np.vstack([body, [[*xy, 1.70]]]))[0]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def car_box(xy):
    corners = [
        [xy[0] + dx, xy[1] + dy, z] for dx in (-2.2, 2.2) for dy in (-0.9, 0.9) for z in (0.1, 1.5)
    ]
    uv = CAMERA.project(np.array(corners))[0]
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])


def detections(index: int, *, tracks: bool = False) -> Detections:
    """What a perfect detector sees in a frame: two people and a parked car."""
    boxes = [*map(person_box, places(index / FPS)), car_box(CAR)]
    return Detections.from_boxes(
        SIZE,
        np.full(3, index),
        np.array(boxes),
        time_s=np.full(3, index / FPS),
        track=np.arange(3) if tracks else None,
        class_name=np.array(["person", "person", "car"]),
    )


def mot_text(*, tracks: bool) -> str:
    """The people as MOTChallenge text."""
    lines = []
    for index in range(FPS * SECONDS):
        for person, (x1, y1, x2, y2) in enumerate(detections(index).box_xyxy[:2]):
            name = person + 1 if tracks else -1
            lines.append(f"{index + 1},{name},{x1},{y1},{x2 - x1},{y2 - y1},1")
    return "\n".join(lines) + "\n"


@cache
def ground(shift: int = 0) -> np.ndarray:
    """A picture with corners everywhere, moved to the right by some pixels."""
    rng = np.random.default_rng(0)
    blocks = rng.integers(30, 220, (SIZE[1] // 16, SIZE[0] // 16 + 8, 3), dtype=np.uint8)
    image = np.kron(blocks, np.ones((16, 16, 1), np.uint8))
    picture = np.ascontiguousarray(image[:, 64 - shift : 64 - shift + SIZE[0]])
    picture.setflags(write=False)
    return picture


def write_video(
    path: Path,
    *,
    seconds: int = SECONDS,
    size: tuple[int, int] = SIZE,
    shifts: list[int] | None = None,
    times_s: np.ndarray | None = None,
    codec: str = "mpeg4",
) -> Path:
    """The empty ground, moved to the right by some pixels from frame to frame; at even times, or
    at those given.
    """
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=FPS)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.bit_rate = 4_000_000
        if times_s is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        for number, shift in enumerate(shifts or [0] * (FPS * seconds)):
            picture = np.ascontiguousarray(ground(shift)[: size[1], : size[0]])
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            if times_s is not None:
                frame.pts, frame.time_base = round(times_s[number] * 1000), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path
