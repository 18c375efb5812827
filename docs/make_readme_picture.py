"""Make the README's pictures of the sample video: docs/images/overlay.jpg and tracks.jpg.

python docs/make_readme_picture.py
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np

from scene4d import track
from scene4d.calibration.calibrating import run
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.writing import write
from scene4d.core.fetching import cache_dir
from scene4d.core.progress import Silent
from scene4d.drawing.overlay import draw_overlay
from scene4d.video.sample import sample_video

IMAGES = Path(__file__).parent / "images"
OVERLAY_PX, TRACKS_PX = 1000, 784


def save(png: bytes, name: str, width: int) -> None:
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture.shape[2] == 4:  # on white, as a page in daylight shows it
        alpha = picture[..., 3:] / 255
        picture = (picture[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
    height = round(picture.shape[0] * width / picture.shape[1])
    smaller = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(IMAGES / name), smaller, [cv2.IMWRITE_JPEG_QUALITY, 85])


def main() -> None:
    video = sample_video(cache_dir() / "samples")
    result = run(video, CalibrateOptions(), Silent())
    drawn = draw_overlay(result.calibration, result.people_bgr)
    save(drawn.png, "overlay.jpg", OVERLAY_PX)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(result, folder, progress=Silent())  # with the scene's background, for the plan
        picture = track(video, folder / "camera.json", folder / "scene").picture
        save(picture.read_bytes(), "tracks.jpg", TRACKS_PX)


if __name__ == "__main__":
    main()
