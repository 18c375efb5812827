"""What keypoints get wrong with everybody alike, against true cameras.

    python -m benchmarks.shared_errors [--data DIR] [--cache DIR]

For every recording with a video: the lean that is seen against the one that the true camera
expects (offset in degrees, and gain), and within tracks the growth of log length with the expected
one and across the picture. It is what the spreads of ``calibration/_drift.py`` were read off.
"""

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.coverage import ROOT, kept
from benchmarks.recordings import RECORDINGS, Recording
from scene4d.calibration import person_segments
from scene4d.core.body import FOOT_HEIGHT_M, PERSON_HEIGHT_M
from scene4d.core.people import Segments

FAR = 0.25
"""Log length, or lean in radians, beyond which somebody is no upright person."""


def shared_errors(recording: Recording, people: Segments) -> tuple[float, float, float, float]:
    """Offset (degrees) and gain of leans; within tracks, growth per e-fold and across."""
    camera = recording.camera
    foot, head = (camera.undistort(uv)[0] for uv in (people.foot_uv, people.head_uv))
    xy, on_ground = camera.locate(people.foot_uv, FOOT_HEIGHT_M)
    top, visible = camera.project(
        np.column_stack([xy, np.full(len(xy), PERSON_HEIGHT_M)]), undistorted=True
    )
    seen, expected = head - foot, top - foot
    longer = np.log(np.hypot(*seen.T) / np.hypot(*expected.T))
    lean, lean_expected = (np.arctan2(v[:, 0], -v[:, 1]) for v in (seen, expected))
    rows = on_ground & visible & (np.abs(longer - np.nanmedian(longer)) < FAR)
    rows &= np.abs(lean - lean_expected) < FAR
    track = people.track[rows]

    def within(values: np.ndarray) -> np.ndarray:
        means = {t: values[track == t].mean() for t in np.unique(track)}
        return values - np.array([means[t] for t in track])

    across = (foot[rows, 0] - camera.K[0, 2]) / (np.hypot(*camera.image_size) / 2)
    size = np.log(np.hypot(*expected[rows].T))
    straight = np.column_stack([np.ones(rows.sum()), lean_expected[rows]])
    offset, gain = np.linalg.lstsq(straight, lean[rows], rcond=None)[0]
    trend = np.column_stack([within(size), within(across)])
    growth, aside = np.linalg.lstsq(trend, within(longer[rows]), rcond=None)[0]
    return float(np.degrees(offset)), float(gain), float(growth), float(aside)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("SCENE4D_DATA", ROOT.parent / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "scene4d-recordings"
    )
    arguments = parser.parse_args()
    print(
        "| recording | lean offset | lean gain | growth | across |\n| --- | --- | --- | --- | --- |"
    )
    for make in RECORDINGS:
        recording, seen = kept(make, arguments.data, arguments.cache)
        if "keypoints" in recording.points:
            found = shared_errors(recording, person_segments(seen.detections))
            print(
                f"| {recording.name} | {found[0]:+.1f}° | "
                + " | ".join(f"{x:+.2f}" for x in found[1:])
                + " |"
            )


if __name__ == "__main__":
    main()
