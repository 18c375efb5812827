"""How well people are placed on real footage by a true camera: the constants of scene/people*.py.

    python -m benchmarks.people_positions [--data DIR] [--step 4]

PETS 2009 S2.L1 is the only clip at hand with a true camera and true positions. The truth are
hand-drawn boxes through the true camera and the model of the body, averaged over one second. They
were drawn with a fixed size and moved between key frames, so they err too: what is fitted here
holds their errors, which the covariance of feet and head errors bounds (last line of the first
part).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks import options_of
from scene4d.core.body import HEIGHT_SIGMA_M
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.perception.people import PeopleDetector, detect_people
from scene4d.tracking._people import (
    BODY_SIGMA_M,
    explain_people,
    locate_people,
)
from scene4d.tracking._people_placing import Placed, Seen, at_height, on_the_ground, pixel_sigma
from scene4d.tracking._people_points import (
    BOTH_FEET,
    BOX_BOTTOM,
    BOX_SHARE,
    BOX_TOP,
    DRAWN_BOX_SHARE,
    HEAD,
    ONE_FOOT,
    Ends,
)
from scene4d.tracking._rays import Rays
from scene4d.video.reader import open_source

CHI2_50, CHI2_95 = 1.386, 5.991
FPS = 10
FEET = slice(20, 26)


@dataclass(frozen=True)
class Truth:
    """Hand-drawn boxes, where their people stood, and where they walked (m/s, over a second)."""

    boxes: Detections
    xy: np.ndarray
    velocity: np.ndarray

    def select(self, rows: np.ndarray) -> "Truth":
        return Truth(self.boxes.select(rows), self.xy[rows], self.velocity[rows])


Pair = tuple[Detections, Truth]
Place = Callable[[Ends, Rays], Placed]


def drawn_truth(boxes: Detections, camera: Camera) -> Truth:
    seen = Seen.by(boxes, camera, DRAWN_BOX_SHARE)
    raw = on_the_ground(seen.below, seen.below_rays).xy_m
    xy, velocity = raw.copy(), np.full_like(raw, np.nan)
    half = FPS // 2
    for label in np.unique(boxes.track):
        rows = np.flatnonzero(boxes.track == label)
        rows = rows[np.argsort(boxes.frame[rows])]
        for i in range(half, len(rows) - half):
            window = rows[i - half : i + half + 1]
            if np.ptp(boxes.frame[window]) == 2 * half:
                xy[rows[i]] = raw[window].mean(axis=0)
                velocity[rows[i]] = (raw[window[-1]] - raw[window[0]]) * (FPS / (2 * half))
    return Truth(boxes, xy, velocity)


def overlaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union of every box of a with every one of b."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=2)
    size_a, size_b = (np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b))
    return common / (size_a[:, None] + size_b[None] - common)


def matched(found: Detections, truth: Truth) -> Pair:
    """Pairs of detections and true people whose boxes overlap by half, and that stand in view."""
    pairs: list[tuple[np.ndarray, np.ndarray]] = []
    for frame in np.unique(found.frame):
        mine = np.flatnonzero(found.frame == frame)
        theirs = np.flatnonzero((truth.boxes.frame == frame) & np.isfinite(truth.xy[:, 0]))
        overlap = overlaps(found.box_xyxy[mine], truth.boxes.box_xyxy[theirs])
        row, column = linear_sum_assignment(-overlap)
        good = overlap[row, column] > 0.5
        pairs.append((mine[row[good]], theirs[column[good]]))
    mine, theirs = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return found.select(mine), truth.select(theirs)


def outwards(camera: Camera, error: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Errors (n, 2) away from the camera, and to the side."""
    away = at - camera.centre_m[:2]
    away /= np.linalg.norm(away, axis=1)[:, None]
    side = np.column_stack([-away[:, 1], away[:, 0]])
    return np.column_stack([(error * away).sum(axis=1), (error * side).sum(axis=1)])


def covering_share(
    end: Ends, covariance_at: Callable[[Ends], np.ndarray], off: np.ndarray
) -> float:
    """The share with which the 95 % ellipse holds 95 % of the errors; 0 where none is needed.

    Of keypoints in both directions, of boxes up and down.
    """

    def too_few(share: float) -> bool:
        both = np.full(end.share.shape, share)
        both[:, 0] = np.where(end.radius_m > 0, end.share[:, 0], share)
        covariance = covariance_at(replace(end, share=both)) + BODY_SIGMA_M**2 * np.eye(2)
        squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off)
        return (squared < CHI2_95).mean() < 0.95

    low, high = 0.0, 0.5
    if not too_few(low):
        return low
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (middle, high) if too_few(middle) else (low, middle)
    return high


def fitted(
    name: str, end: Ends, rays: Rays, place: Place, by: str, truth: np.ndarray, camera: Camera
) -> np.ndarray:
    """Errors of one source alone, and the share that covers them; returns the errors."""
    placed = place(end, rays)
    rows = placed.known & (end.by == by)
    off = placed.xy_m[rows] - truth[rows]
    share = covering_share(end, lambda e: place(e, rays).covariance_m2[rows], off)
    error = np.full_like(truth, np.nan)
    error[rows] = outwards(camera, off, truth[rows])
    distance = np.linalg.norm(off, axis=1)
    print(
        f"{name:24} n {rows.sum():4}  median {np.median(distance):.2f} m, "
        f"p90 {np.quantile(distance, 0.9):.2f} m; away {np.median(error[rows, 0]):+.2f} ± "
        f"{error[rows, 0].std():.2f}, aside {np.median(error[rows, 1]):+.2f} ± "
        f"{error[rows, 1].std():.2f}; share that covers 95 %: {share:.3f}"
    )
    return error


def sources(found: Detections, truth: Truth, rcnn: Pair, camera: Camera) -> None:
    """Every source alone, and the spreads that fit it."""
    height = float(np.nanmedian(implied_height_m(found, camera)[0]))
    print(f"people are {height:.2f} m tall by their keypoints (median)\n")

    def upper(end: Ends, rays: Rays) -> Placed:
        n = len(rays.direction)
        return at_height(end, rays, np.full(n, height), np.full(n, HEIGHT_SIGMA_M))

    seen = Seen.by(found, camera, BOX_SHARE)
    args = (truth.xy, camera)
    feet = fitted("both feet", seen.below, seen.below_rays, on_the_ground, BOTH_FEET, *args)
    head = fitted("head", seen.above, seen.above_rays, upper, HEAD, *args)
    hidden = found.keypoint_score.copy()
    hidden[:, [21, 23, 25]] = 0.0
    one = Seen.by(replace(found, keypoint_score=hidden), camera, BOX_SHARE)
    fitted("left foot", one.below, one.below_rays, on_the_ground, ONE_FOOT, *args)
    for name, boxes, there in (("YOLOX box", found, truth), ("Faster R-CNN box", *rcnn)):
        seen = Seen.by(boxes.without_keypoints(), camera, BOX_SHARE)
        args = (there.xy, camera)
        fitted(f"{name}, bottom", seen.below, seen.below_rays, on_the_ground, BOX_BOTTOM, *args)
        fitted(f"{name}, top", seen.above, seen.above_rays, upper, BOX_TOP, *args)
    for name, column in (("away", 0), ("aside", 1)):
        pair = np.column_stack([feet[:, column], head[:, column]])
        pair = pair[np.isfinite(pair).all(axis=1)]
        for label in np.unique(truth.boxes.track):
            rows = truth.boxes.track[np.isfinite(feet[:, 0] + head[:, 0])] == label
            pair[rows] -= pair[rows].mean(axis=0) if rows.any() else 0.0
        common = np.sqrt(max(np.cov(pair.T)[0, 1], 0.0))
        print(f"feet and head err together {name} by {common:.2f} m within tracks")


def judged(name: str, located: Located, truth: Truth) -> None:
    """Errors and coverage of one way."""
    rows = located.known
    error = located.xy_m[rows] - truth.xy[rows]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(located.covariance_m2[rows]), error)
    distance = np.linalg.norm(error, axis=1)
    print(
        f"{name:40} n {rows.sum():4} of {len(rows):4}  median {np.median(distance):.2f} m, "
        f"p90 {np.quantile(distance, 0.9):.2f} m, inside the 95 % ellipse "
        f"{(squared < CHI2_95).mean():.1%}, the 50 % {(squared < CHI2_50).mean():.1%}"
    )


def combined(found: Detections, truth: Truth, rcnn: Pair, camera: Camera) -> None:
    judged("keypoints and boxes", locate_people(found, camera), truth)
    used = explain_people(found, camera)
    feet = used.lower == BOTH_FEET
    judged("  of these, not both feet seen", used.located.select(~feet), truth.select(~feet))
    hidden = found.keypoint_score.copy()
    hidden[:, FEET] = 0.0
    box = found.box_xyxy * [1, 1, 1, 0] + [0, 0, 0, camera.image_size[1] - 1]
    legs = replace(found, keypoint_score=hidden, box_xyxy=box)
    judged("  legs hidden by hand: head and height", locate_people(legs, camera), truth)
    boxes = found.without_keypoints()
    judged("YOLOX boxes alone", locate_people(boxes, camera), truth)
    tight = locate_people(boxes, camera, box_share=DRAWN_BOX_SHARE)
    judged("YOLOX boxes alone, as if drawn", tight, truth)
    judged("Faster R-CNN boxes", locate_people(rcnn[0], camera), rcnn[1])
    own = locate_people(truth.boxes, camera, box_share=DRAWN_BOX_SHARE)
    judged("hand-drawn boxes (circular)", own, truth)


def disagreement(rcnn: Pair, camera: Camera) -> None:
    """Where the two ends of boxes disagree: which is right, and what is said of it."""
    boxes, truth = rcnn
    seen, n = Seen.by(boxes, camera, BOX_SHARE), len(boxes)
    upper = at_height(seen.above, seen.above_rays, np.full(n, 1.70), np.full(n, HEIGHT_SIGMA_M))
    lower = on_the_ground(seen.below, seen.below_rays)
    gap, total = upper.xy_m - lower.xy_m, upper.covariance_m2 + lower.covariance_m2
    apart = np.sqrt(np.einsum("ni,nij,nj->n", gap, np.linalg.inv(total), gap))
    located = locate_people(boxes, camera)
    off = located.xy_m - truth.xy
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(located.covariance_m2), off)
    for low, high in ((0, 1), (1, 2), (2, 3), (3, 4), (4, np.inf)):
        rows = (apart >= low) & (apart < high)
        top, bottom, used = (
            np.sqrt((way[rows] ** 2).sum(axis=1).mean())
            for way in (upper.xy_m - truth.xy, lower.xy_m - truth.xy, off)
        )
        print(
            f"ends {low} to {high} sigma apart, n {rows.sum():4}: error (rms) of the top "
            f"{top:.2f} m, of the bottom {bottom:.2f} m, of what is used {used:.2f} m; inside the "
            f"95 % ellipse {(squared[rows] < CHI2_95).mean():.1%}"
        )


def persistence(found: Detections, truth: Truth, camera: Camera) -> None:
    """How long errors last within a track: what a smoother may not average away."""
    error = outwards(camera, locate_people(found, camera).xy_m - truth.xy, truth.xy)
    for seconds in (0.4, 0.8, 1.6, 3.2, 6.4):
        pairs = [
            (i, j)
            for label in np.unique(truth.boxes.track)
            for i in np.flatnonzero(truth.boxes.track == label)
            for j in np.flatnonzero(
                (truth.boxes.track == label)
                & (found.frame == found.frame[i] + round(seconds * FPS))
            )
        ]
        if pairs:
            first, second = error[np.array(pairs).T]
            good = (np.abs(first) < 1).all(axis=1) & (np.abs(second) < 1).all(axis=1)
            both = [np.corrcoef(first[good, k], second[good, k])[0, 1] for k in (0, 1)]
            print(f"errors {seconds} s apart correlate by {both[0]:.2f} away, {both[1]:.2f} aside")


def implied_height_m(
    detections: Detections, camera: Camera, *, box_share: float = BOX_SHARE
) -> tuple[np.ndarray, np.ndarray]:
    """Height (m) of every person by this sighting alone, and its standard deviation.

    The ray through the upper end passes the vertical line over the lower end at that height. From
    both feet and the head, or from boxes where there are no keypoints at all; NaN for all others.
    """
    seen = Seen.by(detections, camera, box_share)
    lower, ray, radius = (
        on_the_ground(seen.below, seen.below_rays),
        seen.above_rays,
        seen.above.radius_m,
    )
    with np.errstate(all="ignore"):  # people straight below the camera have no direction
        foot = lower.xy_m - radius[:, None] * ray.row_normal[:, :2] - ray.origin_m[:2]
        along = np.hypot(ray.direction[:, 0], ray.direction[:, 1])
        towards = ray.direction[:, :2] / along[:, None]
        rise = ray.direction[:, 2] / along  # of the ray, metres per metre of ground
        depth = (foot * towards).sum(axis=1) / along
        height = ray.origin_m[2] + depth * ray.direction[:, 2] + radius * (1 + ray.row_normal[:, 2])
        sideways = np.einsum("ni,nij->nj", towards, ray.by_uv[:, :2])
        by_uv = depth[:, None] * (ray.by_uv[:, 2] - rise[:, None] * sideways)
        by_foot = rise[:, None] * towards
        noise = by_uv * pixel_sigma(seen.above.share, ray.focal_px / depth)
        variance = (noise**2).sum(axis=1)
        variance += np.einsum("ni,nij,nj->n", by_foot, lower.covariance_m2, by_foot)
        whole = lower.known & (depth > 0) & np.isfinite(variance)
    if detections.keypoint_names:
        whole &= (seen.below.by == BOTH_FEET) & (seen.above.by == HEAD)
    return np.where(whole, height, np.nan), np.where(whole, np.sqrt(variance), np.nan)


def heights(found: Detections, truth: Truth, camera: Camera) -> None:
    height, sigma = implied_height_m(found, camera)
    means, rest = [], []
    for label in np.unique(truth.boxes.track):
        rows = (truth.boxes.track == label) & np.isfinite(height)
        if rows.sum() >= 15:
            means.append(np.median(height[rows]))
            rest.append((height[rows] - means[-1]) / sigma[rows])
    print(
        f"height: spread {np.std(means):.3f} m between {len(means)} tracks around "
        f"{np.mean(means):.2f} m; within them {np.std(np.concatenate(rest)):.2f} of the sigma "
        f"stated ({np.nanmedian(sigma):.3f} m)"
    )


def headings(found: Detections, truth: Truth, camera: Camera) -> None:
    located = locate_people(found, camera)
    walking = np.hypot(*truth.velocity.T) > 0.7
    way = np.arctan2(truth.velocity[:, 1], truth.velocity[:, 0])
    off = np.angle(np.exp(1j * (located.heading_rad - way)))[walking]
    sigma = located.heading_sigma_rad[walking]
    seen = np.isfinite(off)
    off, sigma = off[seen], sigma[seen]
    size = np.degrees(np.abs(off))
    print(
        f"heading against walking, {seen.sum()} of {walking.sum()} who walk: "
        f"bias {np.degrees(np.angle(np.exp(1j * off).mean())):+.0f}°, "
        f"median {np.median(size):.0f}°, "
        f"p75 {np.quantile(size, 0.75):.0f}°, p90 {np.quantile(size, 0.9):.0f}°, over 90° "
        f"{(size > 90).mean():.1%}; stated sigma {np.degrees(np.median(sigma)):.0f}°, within 2 "
        f"sigma {(np.abs(off) < 2 * sigma).mean():.1%}"
    )


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--step", type=int, default=4, help="every so many frames")
    asked = parser.parse_args()
    folder = asked.data / "pets2009"
    camera = read_camera(folder / "View_001.xml")
    size = camera.image_size
    drawn = read_annotations(folder / "PETS2009-S2L1.xml", image_size=size, fps=float(FPS))
    truth = drawn_truth(drawn, camera)
    people = PeopleDetector.default()
    with open_source(folder / "vtest.avi") as source:
        frames = source.frames(range(0, source.frame_count, asked.step))
        found, there = matched(detect_people(frames, people), truth)
    others = read_annotations(folder / "frcnn_det.txt", image_size=size, fps=float(FPS))
    rcnn = matched(others, truth)
    sources(found, there, rcnn, camera)
    print()
    combined(found, there, rcnn, camera)
    print()
    disagreement(rcnn, camera)
    print()
    persistence(found, there, camera)
    heights(found, there, camera)
    headings(found, there, camera)


if __name__ == "__main__":
    main()
