"""What keypoints and boxes get wrong with everybody alike, against true cameras.

    python -m benchmarks.shared_errors [--data DIR] [--cache DIR]

For every recording: the lean of keypoints against the one that the true camera expects (offset in
degrees, and gain); within tracks the growth of log length with the expected one and across the
picture; and between people the growth of their mean log lengths. It is what the spreads of
``calibration/_drift.py`` were read off.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import options_of
from benchmarks.coverage import kept
from benchmarks.recordings import RECORDINGS, Recording
from scene4d.calibration import person_segments
from scene4d.core.body import FOOT_HEIGHT_M, PERSON_HEIGHT_M
from scene4d.core.people import Segments

FAR = 0.25
"""Log length, or lean in radians, beyond which somebody is no upright person."""
MANY = 20
"""More sightings of one person say no more of how tall it is."""


def shared_errors(recording: Recording, people: Segments) -> np.ndarray:
    """Offset (degrees) and gain of leans; within tracks, growth per e-fold and across; growth per
    e-fold between people.
    """
    camera = recording.camera
    foot, head = (camera.undistort(uv)[0] for uv in (people.foot_uv, people.head_uv))
    foot_height_m = 0.0 if people.from_box.all() else FOOT_HEIGHT_M
    xy, on_ground = camera.locate(people.foot_uv, foot_height_m)
    top, visible = camera.project(
        np.column_stack([xy, np.full(len(xy), PERSON_HEIGHT_M)]), undistorted=True
    )
    seen, expected = head - foot, top - foot
    longer = np.log(np.hypot(*seen.T) / np.hypot(*expected.T))
    lean, lean_expected = (np.arctan2(v[:, 0], -v[:, 1]) for v in (seen, expected))
    rows = on_ground & visible & (np.abs(longer - np.nanmedian(longer)) < FAR)
    rows &= np.abs(lean - lean_expected) < FAR
    _, track = np.unique(people.track[rows], return_inverse=True)
    count = np.bincount(track)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(track, values) / count

    across = (foot[rows, 0] - camera.K[0, 2]) / (np.hypot(*camera.image_size) / 2)
    size, longer = np.log(np.hypot(*expected[rows].T)), longer[rows]
    straight = np.column_stack([np.ones(rows.sum()), lean_expected[rows]])
    offset, gain = np.linalg.lstsq(straight, lean[rows], rcond=None)[0]
    trend = np.column_stack([values - mean(values)[track] for values in (size, across)])
    growth, aside = np.linalg.lstsq(trend, longer - mean(longer)[track], rcond=None)[0]
    between = np.polyfit(mean(size), mean(longer), 1, w=np.sqrt(np.minimum(count, MANY)))[0]
    return np.array([np.degrees(offset), gain, growth, aside, between])


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / "scene4d-recordings"
    )
    arguments = parser.parse_args()
    print("| recording | people | lean offset | lean gain | growth | across | between people |")
    print("| --- " * 7 + "|")
    for make in RECORDINGS:
        recording, seen = kept(make, arguments.data, arguments.cache)
        for kind in recording.points:
            alone = seen.detections.without_keypoints() if kind == "boxes" else seen.detections
            found = [f"{x:+.2f}" for x in shared_errors(recording, person_segments(alone))]
            found[0] += "°"
            if kind == "boxes":  # which have no lean
                found[:2] = "", ""
            print(f"| {recording.name} | {kind} | " + " | ".join(found) + " |")


if __name__ == "__main__":
    main()
