"""Small videos that are written on the spot; each frame carries its number as grey bars."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

SIZE = (160, 128)
BITS = 12


def stamped(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A grey picture whose top row of squares spells ``number`` in binary, top-left first."""
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    image[size[1] // 2 :] = (200, 40, 40)  # blue below, so that turns and channels show
    width = size[0] // BITS
    for bit in range(BITS):
        value = 235 if number >> bit & 1 else 20
        image[: size[1] // 4, bit * width : (bit + 1) * width] = value
    return image


def stamp(image_bgr: np.ndarray) -> int:
    """The number that :func:`stamped` wrote."""
    height, width = image_bgr.shape[0], image_bgr.shape[1] // BITS
    row = image_bgr[height // 8, :, 1]
    return sum(1 << bit for bit in range(BITS) if row[bit * width + width // 2] > 128)


Writer = Callable[..., Path]


@pytest.fixture
def write_video(tmp_path: Path) -> Writer:
    def write(
        name: str,
        count: int = 60,
        *,
        rate: int = 25,
        codec: str = "libx264",
        gop: int = 20,
        b_frames: int = 2,
        size: tuple[int, int] = SIZE,
        times_ms: Sequence[int] | None = None,
        turned: tuple[int, bool, bool] | None = None,
        container: dict[str, str] | None = None,
        sound: bool = False,
    ) -> Path:
        path = tmp_path / name
        with av.open(str(path), "w", options=container or {}) as out:
            options = {"g": str(gop), "bf": str(b_frames), "threads": "1"}
            if codec == "libx264":
                options |= {"preset": "ultrafast", "sc_threshold": "0", "keyint_min": str(gop)}
            if codec == "libx265":
                quiet = f"log-level=none:keyint={gop}:min-keyint={gop}:bframes={b_frames}"
                options |= {"preset": "ultrafast", "x265-params": quiet}
            if codec == "libsvtav1":
                options = {"g": str(gop), "preset": "8", "crf": "15", "svtav1-params": "lp=1"}
            stream = out.add_stream(codec, rate=rate, options=options)
            stream.width, stream.height = size
            stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
            if times_ms is not None:
                stream.codec_context.time_base = Fraction(1, 1000)
            if turned is not None:
                degrees, hflip, vflip = turned
                stream.set_display_rotation(degrees, hflip=hflip, vflip=vflip)
            if sound:
                voice = out.add_stream("aac", rate=8000)
                silence = np.zeros((1, 1024), np.float32)
            for i in range(count):
                if sound:
                    quiet = av.AudioFrame.from_ndarray(silence, format="fltp", layout="mono")
                    quiet.sample_rate, quiet.pts = 8000, 1024 * i
                    out.mux(voice.encode(quiet))
                frame = av.VideoFrame.from_ndarray(stamped(i, size), format="bgr24")
                if times_ms is not None:
                    frame.pts, frame.time_base = int(times_ms[i]), Fraction(1, 1000)
                out.mux(stream.encode(frame))
            out.mux(stream.encode())
        return path

    return write


@pytest.fixture
def read_stamp() -> Callable[[np.ndarray], int]:
    return stamp


@pytest.fixture(scope="session")
def textured() -> np.ndarray:
    """A 640x360 picture with structure at several scales and no repetition."""
    rng = np.random.default_rng(3)
    layers = []
    for sigma in (2, 6, 20):
        noise = rng.normal(size=(360, 640, 3)).astype(np.float32)
        smooth = cv2.GaussianBlur(noise, (0, 0), sigma)
        layers.append(smooth / smooth.std())
    return np.clip(128 + 22 * sum(layers), 0, 255).astype(np.uint8)
