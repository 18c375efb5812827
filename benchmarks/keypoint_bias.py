"""What keypoints get wrong on real footage, against a true camera: the constants in docs/method.md.

    python -m benchmarks.keypoint_bias [--data DIR]

On the PETS video: does a turned picture give a body turned as much (rotation), how tall are people
at each distance (size), and where is the head across the body: by walking speed, by place in the
picture, and how alike within one person's track (hand-drawn tracks).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks import options_of
from scene4d.calibration import person_segments
from scene4d.core.camera import Camera
from scene4d.core.geometry import vertical_vanishing_point
from scene4d.core.people import Detections, Segments
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.perception.people import PeopleDetector, detect_people
from scene4d.video.frames import Frame
from scene4d.video.reader import open_source

FOOT_HEIGHT_M = 0.04


@dataclass
class Turned:
    """Frames turned about their centre."""

    frames: list[Frame]
    angle_rad: float

    def __iter__(self):
        for frame in self.frames:
            height, width = frame.image_bgr.shape[:2]
            middle = ((width - 1) / 2, (height - 1) / 2)
            turn = cv2.getRotationMatrix2D(middle, np.degrees(self.angle_rad), 1.0)
            yield Frame(
                frame.index, frame.time_s, cv2.warpAffine(frame.image_bgr, turn, (width, height))
            )


def rotation(people: PeopleDetector, frames: list[Frame], boxes: Detections) -> None:
    """Keypoints of the same boxes in pictures turned by ± 10 degrees."""
    angle = np.radians(10.0)
    headings = []
    for sign in (1, -1):
        found = []
        for frame in Turned(frames, sign * angle):
            mine = boxes.select(boxes.frame == frame.index)
            height, width = frame.image_bgr.shape[:2]
            middle = np.array([(width - 1) / 2, (height - 1) / 2])
            c, s = np.cos(sign * angle), np.sin(sign * angle)
            centre = (mine.box_xyxy[:, :2] + mine.box_xyxy[:, 2:]) / 2 - middle
            centre = centre @ np.array([[c, -s], [s, c]]) + middle
            half = (mine.box_xyxy[:, 2:] - mine.box_xyxy[:, :2]) / 2
            uv, score = people.keypoints.estimate(
                frame.image_bgr, np.hstack([centre - half, centre + half])
            )
            body = uv[:, 17] - uv[:, 20:26].mean(axis=1)
            good = score[:, [17, *range(20, 26)]].min(axis=1) > 0.3
            found.append(np.where(good, np.arctan2(body[:, 0], -body[:, 1]), np.nan))
        headings.append(np.concatenate(found))
    response = headings[1] - headings[0]
    response = response[np.isfinite(response)]
    print(
        f"turned by 20.0 degrees, bodies turn by {np.degrees(np.median(response)):.2f} "
        f"(median of {len(response)} people)"
    )


def across_and_height(
    camera: Camera, segments: Segments
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height (m), head across the body (share of height), ground position, by the true camera."""
    head, _ = camera.undistort(segments.head_uv)
    xy, _ = camera.locate(segments.foot_uv, FOOT_HEIGHT_M)
    feet = np.column_stack([xy, np.full(len(xy), FOOT_HEIGHT_M)]) @ camera.R.T + camera.t
    up = camera.R[:, 2]
    x = (head - camera.K[:2, 2]) / np.diag(camera.K)[:2]
    a, b = up[:2] - x * up[2], x * feet[:, 2:] - feet[:, :2]
    rise = (a * b).sum(axis=1) / (a * a).sum(axis=1)
    across = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / (a * a).sum(axis=1) / rise
    return rise + FOOT_HEIGHT_M, across, xy


def true_tracks(segments: Segments, truth: Detections) -> np.ndarray:
    """Hand-drawn track (n,) of the box nearest to each segment's box, -1 without one."""
    track = np.full(len(segments), -1)
    centre = (segments.box_xyxy[:, :2] + segments.box_xyxy[:, 2:]) / 2
    for row in range(len(segments)):
        mine = truth.select(truth.frame == segments.frame[row])
        if len(mine):
            gap = np.linalg.norm(
                (mine.box_xyxy[:, :2] + mine.box_xyxy[:, 2:]) / 2 - centre[row], axis=1
            )
            height = mine.box_xyxy[:, 3] - mine.box_xyxy[:, 1]
            if gap.min() < 0.2 * height[gap.argmin()]:
                track[row] = mine.track[gap.argmin()]
    return track


def rightward_speed(
    camera: Camera, xy: np.ndarray, time_s: np.ndarray, track: np.ndarray
) -> np.ndarray:
    """Speed (m/s) to the right as the camera sees it, over about two seconds of each track."""
    away = xy - camera.centre_m[:2]
    right = np.column_stack([away[:, 1], -away[:, 0]]) / np.linalg.norm(away, axis=1)[:, None]
    speed = np.full(len(xy), np.nan)
    for label in np.unique(track[track >= 0]):
        rows = np.flatnonzero(track == label)
        for row in rows:
            near = rows[np.abs(time_s[rows] - time_s[row]) <= 1.0]
            if np.ptp(time_s[near]) > 0.8:
                first, last = near[time_s[near].argmin()], near[time_s[near].argmax()]
                speed[row] = (xy[last] - xy[first]) @ right[row] / (time_s[last] - time_s[first])
    return speed


def report(camera: Camera, segments: Segments, truth: Detections) -> None:
    height, across, xy = across_and_height(camera, segments)
    track = true_tracks(segments, truth)
    speed = rightward_speed(camera, xy, segments.time_s, track)
    nadir = vertical_vanishing_point(camera.K, camera.R)
    foot = camera.undistort(segments.foot_uv)[0]
    lean = np.arctan2(*(foot - nadir[:2] / nadir[2]).T * np.array([[1], [-1]]))
    distance = np.linalg.norm(xy - camera.centre_m[:2], axis=1)
    good = (
        np.isfinite(speed)
        & (np.abs(across) < 0.2)
        & (np.abs(height / np.median(height) - 1) < 0.25)
    )

    design = np.column_stack([np.ones(good.sum()), lean[good], speed[good]])
    answer = np.linalg.lstsq(design, across[good], rcond=None)[0]
    rest = across[good] - design @ answer
    bread, meat = np.linalg.inv(design.T @ design), np.zeros((3, 3))
    tracks = track[good]
    for label in np.unique(tracks):
        score = design[tracks == label].T @ rest[tracks == label]
        meat += np.outer(score, score)
    spread = np.sqrt(np.diag(bread @ meat @ bread))
    print(f"head ahead of the feet: {answer[2]:.1%} ± {spread[2]:.1%} of the height per m/s")
    print(f"lean against place: {answer[1]:+.0%} ± {spread[1]:.0%} of what the true camera says")
    labels = [label for label in np.unique(tracks) if (tracks == label).sum() >= 15]
    seen = across[good]  # as the solver sees it, which knows nothing of walking
    means = [seen[tracks == label].mean() for label in labels]
    within = np.sqrt(np.mean([seen[tracks == label].var() for label in labels]))
    between = np.std(means)
    print(
        f"across the body: {between:.1%} between and {within:.1%} within {len(labels)} tracks, "
        f"correlation {between**2 / (between**2 + within**2):.2f}"
    )
    slope = np.polyfit(np.log(distance[good]), np.log(height[good]), 1)[0]
    print(f"median height {np.median(height[good]):.2f} m, {slope:+.1%} per e-fold of distance")


def main() -> None:
    parser = options_of(__doc__)
    folder = parser.parse_args().data / "pets2009"
    camera = read_camera(folder / "View_001.xml")
    truth = read_annotations(folder / "PETS2009-S2L1.xml", image_size=camera.image_size, fps=10.0)
    people = PeopleDetector.default()
    with open_source(folder / "vtest.avi") as source:
        frames = list(source.frames(range(0, source.frame_count, 4)))
    detections = detect_people(frames, people)
    rotation(people, frames[::8], detections)
    report(camera, person_segments(detections), truth)


if __name__ == "__main__":
    main()
