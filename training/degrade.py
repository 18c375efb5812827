"""What cameras, weather and recorders do to a picture. All take and return (h, w, 3) uint8."""

import cv2
import numpy as np

Rng = np.random.Generator


def degraded(picture: np.ndarray, rng: Rng) -> np.ndarray:
    """A random chain of light, weather, lens, recorder and overlay; a third stay almost as good."""
    out = picture.astype(np.float32)
    if rng.random() < 0.35:
        out = _defocused(resampled(out, rng, worst=0.5), rng)
        out = out + rng.normal(0, rng.uniform(0, 3), out.shape).astype(np.float32)
        return np.clip(out, 0, 255).astype(np.uint8)
    out = _light(out, rng)
    if rng.random() < 0.12:
        out = _fog(out, rng)
    if rng.random() < 0.12:
        out = _night(out, rng)
    if rng.random() < 0.08:
        out = _rain(out, rng)
    out = _defocused(resampled(out, rng), rng)
    if rng.random() < 0.12:
        out = _smeared(out, rng)
    out = out + rng.normal(0, 1, out.shape).astype(np.float32) * _log_uniform(rng, 0.5, 10)
    if rng.random() < 0.15:
        out = np.repeat(out.mean(axis=-1, keepdims=True), 3, axis=-1)
    if rng.random() < 0.3:
        out = _overlay(out, rng)
    out = np.clip(out, 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        quality = int(rng.integers(25, 95))
        _, data = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, quality])
        out = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return out


def resampled(picture: np.ndarray, rng: Rng, worst: float = 0.27) -> np.ndarray:
    """Down and up again, with kernels of every kind, so that sharpness tells nothing.

    Panoramas have few pixels a degree, so a narrow crop of one is blurrier than a wide one; every
    picture loses some of its sharpness here, whatever its field of view.
    """
    height, width = picture.shape[:2]
    share = _log_uniform(rng, worst, 1.0)
    small = (max(8, round(width * share)), max(6, round(height * share)))
    down = cv2.INTER_AREA if rng.random() < 0.7 else cv2.INTER_LINEAR
    up = (cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4)[rng.integers(3)]
    out = cv2.resize(
        cv2.resize(picture, small, interpolation=down), (width, height), interpolation=up
    )
    if rng.random() < 0.25:
        # Sharpening, as cameras do.
        amount = rng.uniform(0.3, 1.5)
        out = out + amount * (out - cv2.GaussianBlur(out, (0, 0), rng.uniform(0.8, 2.5)))
    return out


def _defocused(picture: np.ndarray, rng: Rng) -> np.ndarray:
    """Out of focus by up to 3 pixels, in three of ten pictures, wide ones as often as narrow."""
    if rng.random() >= 0.3:
        return picture
    return cv2.GaussianBlur(picture, (0, 0), _log_uniform(rng, 0.6, 3.0))


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _light(picture: np.ndarray, rng: Rng) -> np.ndarray:
    tint = np.exp(rng.normal(0, 0.08, 3)).astype(np.float32)
    out = 255 * np.power(np.clip(picture / 255, 0, 1), _log_uniform(rng, 0.65, 1.45))
    out = out * (tint * _log_uniform(rng, 0.7, 1.5))
    mean = out.mean()
    out = (out - mean) * rng.uniform(0.6, 1.3) + mean
    if rng.random() < 0.3:
        grey = out.mean(axis=-1, keepdims=True)
        out = grey + (out - grey) * np.float32(rng.uniform(0.1, 1.6))
    if rng.random() < 0.2:
        height, width = out.shape[:2]
        y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
        out = out * (1 - np.float32(rng.uniform(0.1, 0.5)) * (x * x + y * y)[..., None] / 2)
    return np.clip(out, 0, 255)


def _fog(picture: np.ndarray, rng: Rng) -> np.ndarray:
    share = np.float32(rng.uniform(0.2, 0.75))
    return picture * (1 - share) + share * np.float32(rng.uniform(120, 230))


def _night(picture: np.ndarray, rng: Rng) -> np.ndarray:
    out = 255 * np.power(picture / 255, np.float32(rng.uniform(1.6, 2.6))) * rng.uniform(0.25, 0.7)
    height, width = picture.shape[:2]
    lamps = np.zeros((height, width), np.float32)
    for _ in range(rng.integers(0, 6)):
        centre = (int(rng.integers(width)), int(rng.integers(height)))
        cv2.circle(lamps, centre, int(rng.integers(1, 4)), float(rng.uniform(100, 255)), -1)
    glow = lamps + 3 * cv2.GaussianBlur(lamps, (0, 0), rng.uniform(3, 12))
    colour = np.array([0.6, 0.85, 1.0], np.float32)
    return out + glow[..., None] * colour + np.float32(rng.normal(0, 6)) + 4


def _rain(picture: np.ndarray, rng: Rng) -> np.ndarray:
    height, width = picture.shape[:2]
    streaks = np.zeros((height, width), np.float32)
    slant = rng.uniform(-0.4, 0.4)
    for _ in range(rng.integers(30, 150)):
        x, y, long = rng.integers(width), rng.integers(height), rng.uniform(4, 16)
        end = (int(x + slant * long), int(y + long))
        cv2.line(streaks, (int(x), int(y)), end, float(rng.uniform(20, 90)), 1, cv2.LINE_AA)
    return picture * 0.9 + streaks[..., None]


def _smeared(picture: np.ndarray, rng: Rng) -> np.ndarray:
    size = int(rng.integers(3, 8))
    kernel = np.zeros((size, size), np.float32)
    angle = rng.uniform(0, np.pi)
    middle, reach = (size - 1) / 2, (size - 1) / 2
    for step in np.linspace(-reach, reach, 3 * size):
        kernel[round(middle + step * np.sin(angle)), round(middle + step * np.cos(angle))] = 1
    return cv2.filter2D(picture, -1, kernel / kernel.sum())


def _overlay(picture: np.ndarray, rng: Rng) -> np.ndarray:
    """A clock, a camera's name, a logo or a black bar, as recorders print them."""
    out = np.ascontiguousarray(picture)
    height, width = out.shape[:2]
    for _ in range(rng.integers(1, 4)):
        text = "".join(rng.choice(list("0123456789:-/ CAM"), rng.integers(4, 20)))
        corner = (int(rng.integers(0, width // 2)), int(rng.choice([10, height - 4])))
        level = float(rng.choice([0, 255, 200]))
        cv2.putText(
            out, text, corner, int(rng.integers(0, 4)), rng.uniform(0.2, 0.45), (level,) * 3
        )
    if rng.random() < 0.2:
        x, y = int(rng.integers(width - 24)), int(rng.choice([2, height - 16]))
        colour = tuple(float(value) for value in rng.uniform(0, 255, 3))
        cv2.rectangle(out, (x, y), (x + int(rng.integers(8, 24)), y + 12), colour, -1)
    if rng.random() < 0.15:
        rows = int(rng.integers(4, 14))
        out[: rows if rng.random() < 0.5 else 0] = 0
        out[height - rows :] = out[height - rows :] * np.float32(rng.random() < 0.5)
    return out
