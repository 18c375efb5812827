"""Make docs/images/overlay.jpg: the report's first figure of the sample video, smaller.

python docs/make_readme_picture.py
"""

from pathlib import Path

import cv2

from scene4d.calibration.calibrating import run
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.fetching import cache_dir
from scene4d.core.progress import Silent
from scene4d.drawing.overlay import draw_overlay
from scene4d.video.sample import sample_video

WIDTH = 1000


def main() -> None:
    result = run(sample_video(cache_dir()), CalibrateOptions(), Silent())
    out = Path(__file__).parent / "images" / "overlay.jpg"
    png = out.with_suffix(".png")
    png.write_bytes(draw_overlay(result.calibration, result.image_bgr).png)
    picture = cv2.imread(str(png))
    png.unlink()
    height = round(picture.shape[0] * WIDTH / picture.shape[1])
    smaller = cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(out), smaller, [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main()
