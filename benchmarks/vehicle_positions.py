"""Where vehicles stand and how large they are: drawn vehicles, speed, and parked vehicles of MEVA.

    python -m benchmarks.vehicle_positions [--annotations DIR] [--data DIR]

Drawn vehicles have known places: typical outlines, and four bodies (saloon, hatchback, SUV, van)
that the fit does not know. DIR holds MEVA's annotations, unpacked from ``annotations.tar.xz``:
there parked vehicles must stay put, and vehicles that two cameras see must stand at one place and
have one size.
The usual stand-in for a vehicle's place, the middle of its box's bottom edge, is measured beside.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import options_of
from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located, Tracks
from scene4d.core.vehicle_shapes import CUBOID, SHAPES
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.tracking._vehicles import JITTER_SHARE, locate_vehicles
from scene4d.tracking.annotated import looks_of
from scene4d.tracking.following import follow

NOISE_SHARE, NOISE_PX = 0.036, 1.4
"""Noise of drawn box edges: a share of the box's width or height, and pixels."""
ELLIPSE_95 = 5.991
MEVA_GROUND_M = 1.0
"""Guess of the ground's height in MEVA's world (0.5 to 1.5 m, not the same for every camera)."""
MEVA_FPS = 30.0
STANDING_PARTS = 5
STANDING_SIGMAS = 2.5
"""A track moves where the median boxes of parts of it differ by more than this many jitters."""

PROFILES = {
    "saloon": ((-0.49, 0.18), (-0.5, 0.45), (-0.47, 0.66), (-0.33, 0.72), (-0.17, 0.98),
               (0.02, 1.0), (0.12, 0.96), (0.25, 0.68), (0.45, 0.56), (0.5, 0.42), (0.49, 0.14)),
    "hatchback": ((-0.49, 0.18), (-0.5, 0.5), (-0.48, 0.66), (-0.42, 0.94), (-0.2, 1.0),
                  (0.05, 0.99), (0.14, 0.93), (0.29, 0.66), (0.46, 0.55), (0.5, 0.4), (0.49, 0.14)),
    "SUV": ((-0.49, 0.22), (-0.5, 0.55), (-0.47, 0.93), (-0.3, 1.0), (0.0, 1.0), (0.1, 0.96),
            (0.24, 0.66), (0.46, 0.6), (0.5, 0.45), (0.48, 0.18)),
    "van": ((-0.5, 0.18), (-0.5, 0.95), (-0.45, 1.0), (0.18, 1.0), (0.25, 0.95), (0.42, 0.6),
            (0.49, 0.5), (0.5, 0.3), (0.49, 0.14)),
}  # fmt: skip
"""Side views (along, up) drawn by hand after common cars, rear to front, as fractions."""


@dataclass(frozen=True)
class Drawn:
    """Vehicles of one class with known places, as one camera sees them."""

    camera: Camera
    detections: Detections
    xy_m: np.ndarray
    heading_rad: np.ndarray
    cut_sides: np.ndarray


def body(profile: str) -> np.ndarray:
    """Points (k, 3) of a car with this side view, rounded corners and a narrower roof."""
    turns = np.array(PROFILES[profile])
    t = np.linspace(0, len(turns) - 1, 60)
    along, up = (np.interp(t, np.arange(len(turns)), column) for column in turns.T)
    waist = np.tile(np.linspace(-0.5, 0.5, 41), 3)
    along, up = np.append(along, waist), np.append(up, np.repeat([0.3, 0.45, 0.55], 41))
    rounding = 1 - 0.28 * np.clip((np.abs(along) - 0.3) / 0.2, 0, 1) ** 2.5
    half = 0.5 * rounding * (1 - 0.22 * np.clip((up - 0.55) / 0.45, 0, 1))
    half *= 1 - 0.08 * np.clip((0.3 - up) / 0.2, 0, 1)
    sides = [np.column_stack([along, side * half, up]) for side in (-1, 1)]
    tyres = [(a, side * 0.455, 0.0) for a in (-0.31, 0.31) for side in (-1, 1)]
    return np.concatenate([*sides, tyres])


def boxes_of(
    camera: Camera, points: np.ndarray, size_m: np.ndarray, heading: np.ndarray, xy: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bounding rectangles (n, 4) of vehicles in the footage, and which are before the camera."""
    local = points[None] * size_m[:, None]
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    x = xy[:, :1] + local[..., 0] * c - local[..., 1] * s
    y = xy[:, 1:] + local[..., 0] * s + local[..., 1] * c
    uv, valid = camera.project(np.stack([x, y, local[..., 2]], axis=-1).reshape(-1, 3))
    uv = uv.reshape(len(xy), -1, 2)
    return np.hstack([uv.min(axis=1), uv.max(axis=1)]), valid.reshape(len(xy), -1).all(axis=1)


def draw(
    camera: Camera,
    count: int,
    rng: np.random.Generator,
    class_name: str = "car",
    points: np.ndarray | None = None,
    cut: bool = False,
) -> Drawn:
    """Vehicles of random sizes and headings, seen with noise; with ``cut`` also at the border."""
    shape, image = SHAPES[class_name], np.array(camera.image_size)
    margin = 0.15 if cut else 0.0
    xy, on_ground = camera.locate(rng.uniform(-margin, 1 + margin, (count, 2)) * image)
    xy, n = xy[on_ground], int(on_ground.sum())
    heading = rng.uniform(-np.pi, np.pi, n)
    size = shape.size_m * np.exp(rng.multivariate_normal(np.zeros(3), shape.log_covariance, n))
    box, good = boxes_of(camera, shape.points if points is None else points, size, heading, xy)
    extent = box[:, 2:] - box[:, :2]
    box = box + rng.normal(size=box.shape) * np.hypot(NOISE_PX, NOISE_SHARE * np.tile(extent, 2))
    inside = np.clip(box, 0, np.tile(image - 1, 2))
    shown = np.prod(np.maximum(inside[:, 2:] - inside[:, :2], 0) / extent, axis=1)
    good &= (extent > 12).all(axis=1) & (extent < 0.8 * image).all(axis=1) & (shown > 0.3)
    cut_sides = (inside != box).sum(axis=1)
    if not cut:
        good &= ((box[:, :2] > 8) & (box[:, 2:] < image - 9)).all(axis=1)
    names = np.full(int(good.sum()), class_name)
    found = Detections.from_boxes(
        camera.image_size, np.zeros(len(names), int), inside[good], class_name=names
    )
    return Drawn(camera, found, xy[good], heading[good], cut_sides[good])


def bottom_centre(camera: Camera, detections: Detections) -> np.ndarray:
    """The usual stand-in: the ground under the middle of the box's bottom edge."""
    return camera.locate(detections.box_foot_uv)[0]


def inside_ellipse(found: Located, xy_m: np.ndarray) -> np.ndarray:
    """Whether the 95 % ellipses contain the true places, for the rows with a place."""
    off = (found.xy_m - xy_m)[found.known]
    inverse = np.linalg.inv(found.covariance_m2[found.known])
    return np.einsum("ni,nij,nj->n", off, inverse, off) < ELLIPSE_95


def heading_error(found: Located, heading_rad: np.ndarray) -> np.ndarray:
    """Error of the headings, as an axis where it is one; NaN where unknown."""
    turn = np.where(found.heading_is_axis, np.pi, 2 * np.pi)
    return (found.heading_rad - heading_rad + turn / 2) % turn - turn / 2


CAMERAS = {
    "5 m, tilt 10°": (40.0, 10.0, 0.0, 5.0, 0.0),
    "8 m, tilt 20°, barrel": (60.0, 20.0, 3.0, 8.0, -0.06),
    "12 m, tilt 35°, cushion": (60.0, 35.0, -5.0, 12.0, 0.08),
    "15 m, tilt 55°": (70.0, 55.0, 10.0, 15.0, 0.0),
    "15 m, tilt 8°, tele": (25.0, 8.0, 0.0, 15.0, 0.0),
}
"""Horizontal field of view, tilt, roll (degrees), height (m), displacement of the corner."""


def camera_of(fov: float, tilt: float, roll: float, height: float, corner: float) -> Camera:
    focal = 960 / np.tan(np.radians(fov) / 2)
    return Camera.from_pose(
        image_size=(1920, 1080),
        focal_px=float(focal),
        tilt_rad=float(np.radians(tilt)),
        roll_rad=float(np.radians(roll)),
        height_m=height,
        distortion=(corner * (focal / np.hypot(960, 540)) ** 2, 0.0, 0.0, 0.0, 0.0),
    )


def line(name: str, drawn: list[Drawn], found: list[Located] | None = None) -> None:
    found = found or [locate_vehicles(d.detections, d.camera) for d in drawn]
    pairs = list(zip(found, drawn, strict=True))
    error = np.concatenate([np.hypot(*(f.xy_m - d.xy_m)[f.known].T) for f, d in pairs])
    base = np.concatenate(
        [np.hypot(*(bottom_centre(d.camera, d.detections) - d.xy_m).T) for d in drawn]
    )
    inside = np.concatenate([inside_ellipse(f, d.xy_m) for f, d in pairs])
    off = np.concatenate([np.abs(heading_error(f, d.heading_rad)) for f, d in pairs])
    sigma = np.concatenate([f.heading_sigma_rad for f in found])
    told = np.isfinite(off)
    known = np.concatenate([f.known for f in found]).mean()
    print(
        f"{name:32}{len(base):6}{known:7.1%}{inside.mean():8.1%}{np.median(error):8.2f}"
        f"{np.nanmedian(base):9.2f}{told.mean():9.0%}{np.degrees(np.median(off[told])):6.0f}°"
        f"{(off[told] < 2 * sigma[told]).mean():8.0%}"
    )


def synthetic(count: int) -> None:
    rng = np.random.default_rng(0)
    cameras = {name: camera_of(*values) for name, values in CAMERAS.items()}
    print(f"{'drawn':32}{'n':>6}{'known':>7}{'in 95 %':>8}{'error':>8}{'bottom':>9}{'heading':>9}")
    for name, camera in cameras.items():
        line(f"car, {name}", [draw(camera, count, rng)])
    for name in ("truck", "bus", "motorcycle", "bicycle"):
        line(name, [draw(camera, count, rng, name) for camera in cameras.values()])
    for name in PROFILES:
        line(name, [draw(c, count, rng, points=body(name)) for c in cameras.values()])
    drawn = [draw(camera, count, rng, cut=True) for camera in cameras.values()]
    for sides in (1, 2):
        line(f"car, {sides} sides cut", [_rows(d, d.cut_sides == sides) for d in drawn])
    drawn = [draw(camera, count, rng) for camera in cameras.values()]
    for sigma in (0.05, 0.3):
        told = []
        for d in drawn:
            given = d.heading_rad + sigma * rng.normal(size=len(d.heading_rad))
            spread = np.full(len(given), sigma)
            told.append(
                locate_vehicles(d.detections, d.camera, heading_rad=given, heading_sigma_rad=spread)
            )
        line(f"car, heading told ± {sigma} rad", drawn, told)
    plain = SHAPES["car"]
    SHAPES["car"] = replace(plain, points=CUBOID)
    line("saloons fitted as full cuboids", [draw(c, count, rng, points=body("saloon"))
                                            for c in cameras.values()])  # fmt: skip
    SHAPES["car"] = plain


def _rows(drawn: Drawn, rows: np.ndarray) -> Drawn:
    return Drawn(
        drawn.camera,
        drawn.detections.select(rows),
        drawn.xy_m[rows],
        drawn.heading_rad[rows],
        drawn.cut_sides[rows],
    )


def speed() -> None:
    for name in ("5 m, tilt 10°", "8 m, tilt 20°, barrel"):
        camera = camera_of(*CAMERAS[name])
        drawn = draw(camera, 20_000, np.random.default_rng(1)).detections
        rows = drawn.select(np.arange(10_000) % len(drawn))
        seconds = []
        for _ in range(3):
            begun = time.perf_counter()
            locate_vehicles(rows, camera)
            seconds.append(time.perf_counter() - begun)
        print(f"10,000 boxes, {name}: {min(seconds):.2f} s")


def meva_camera(data: Path, name: str) -> Camera:
    camera = read_camera(data / "meva" / "cameras" / f"{name}.krtd")
    return replace(camera, t=camera.t + camera.R[:, 2] * MEVA_GROUND_M)


def meva_clips(annotations: Path, camera: Camera, name: str) -> Iterator[tuple[str, Detections]]:
    """Vehicles of each clip of a camera by track and frame, with the clip's name."""
    for path in sorted(annotations.glob(f"*.{name}.geom.yml")):
        boxes = read_annotations(path, image_size=camera.image_size, fps=MEVA_FPS)
        boxes = boxes.select(boxes.class_name == "vehicle")
        yield path.name, boxes.select(np.lexsort((boxes.frame, boxes.track)))


def stands(box_xyxy: np.ndarray) -> bool:
    """Whether the boxes of a track, in order of time, show something that does not move.

    The boxes are cut into at most five parts; the parts' median boxes must agree within the jitter
    of boxes. People who pass before a parked vehicle disturb a median only where they hide it for
    half of a part. False for fewer than two boxes.
    """
    boxes = box_xyxy[np.isfinite(box_xyxy).all(axis=1)]
    if len(boxes) < 2:
        return False
    parts = np.array_split(boxes, min(len(boxes), STANDING_PARTS))
    medians = np.array([np.median(part, axis=0) for part in parts])
    box = np.median(boxes, axis=0)
    jitter = np.hypot(1.0, JITTER_SHARE * np.tile(box[2:] - box[:2], 2))
    return bool((np.ptp(medians, axis=0) <= STANDING_SIGMAS * jitter).all())


def standing(boxes: Detections) -> Detections:
    keep = [t for t in np.unique(boxes.track) if stands(boxes.box_xyxy[boxes.track == t])]
    return boxes.select(np.isin(boxes.track, keep))


def _spread(xy: np.ndarray) -> float:
    return float(np.sqrt(xy.var(axis=0).sum())) if len(xy) > 1 else np.nan


def parked(annotations: Path, data: Path) -> None:
    """How far the places of standing vehicles move within their tracks, frame by frame."""
    print("MEVA parked   tracks  sd median  sd p95  <= 0.3 m   bottom: median   p95   distance")
    for name in ("G328", "G341", "G424", "G506"):
        camera = meva_camera(data, name)
        fitted, bottom, far = [], [], []
        for _, boxes in meva_clips(annotations, camera, name):
            still = standing(boxes)
            found, base = locate_vehicles(still, camera), bottom_centre(camera, still)
            for track in np.unique(still.track):
                mine = (still.track == track) & found.known
                fitted.append(_spread(found.xy_m[mine]))
                bottom.append(_spread(base[mine]))
                if mine.any():
                    place = np.median(found.xy_m[mine], axis=0)
                    far.append(np.hypot(*(place - camera.centre_m[:2])))
        f, b = np.array(fitted), np.array(bottom)
        print(
            f"{name:14}{len(f):6}{np.nanmedian(f):11.3f}{np.nanquantile(f, 0.95):8.3f}"
            f"{np.mean(f <= 0.3):10.1%}{np.nanmedian(b):17.3f}{np.nanquantile(b, 0.95):6.3f}"
            f"{np.nanmedian(far):11.0f}"
        )


def two_cameras(annotations: Path, data: Path, names: tuple[str, str] = ("G328", "G424")) -> None:
    """Vehicles that two cameras see at one moment: how far apart both put them."""
    cameras = [meva_camera(data, name) for name in names]
    clips: list[dict[str, Detections]] = []
    for camera, name in zip(cameras, names, strict=True):
        clips.append({})
        for path, boxes in meva_clips(annotations, camera, name):
            start = int(path.split(".")[1][6:8])  # seconds; the clips start at full minutes
            boxes = replace(boxes, frame=boxes.frame + round(MEVA_FPS) * start)
            clips[-1][path[:16]] = boxes
    apart: dict[tuple[str, int, int], np.ndarray] = {}
    for clip in sorted(set(clips[0]) & set(clips[1])):
        places = []
        for camera, boxes in zip(cameras, (clips[0][clip], clips[1][clip]), strict=True):
            found = locate_vehicles(boxes, camera)
            both = np.hstack([found.xy_m, bottom_centre(camera, boxes)])
            places.append((boxes, both))
        for key, gap in _matches(*places):
            apart.setdefault((clip, *key), gap)
    gaps = np.array(list(apart.values()))
    for column, method in ((0, "fitted"), (2, "bottom")):
        gap = gaps[:, column : column + 2]
        rest = gap - np.median(gap, axis=0)
        print(
            f"{names[0]} and {names[1]}, {method}: {len(gap)} vehicles, apart by "
            f"{np.median(np.hypot(*gap.T)):.2f} m (median), "
            f"{np.median(np.hypot(*rest.T)):.2f} m without the shift common to all"
        )


def _matches(
    first: tuple[Detections, np.ndarray], second: tuple[Detections, np.ndarray]
) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """Median differences of vehicles seen together, one per place (2 m grid) and clip.

    They are matched where either way of placing them puts them within 5 m of one another, so that
    neither is favoured.
    """
    for a in np.unique(first[0].track):
        rows = np.flatnonzero(first[0].track == a)
        options = []
        for b in np.unique(second[0].track):
            others = np.flatnonzero(second[0].track == b)
            _, i, j = np.intersect1d(
                first[0].frame[rows], second[0].frame[others], return_indices=True
            )
            if len(i) >= 30:
                gap = np.nanmedian(first[1][rows[i]] - second[1][others[j]], axis=0)
                options.append((min(np.hypot(*gap[:2]), np.hypot(*gap[2:])), gap))
        if options:
            nearest, gap = min(options, key=lambda option: option[0])
            if nearest < 5.0:
                x, y = np.nanmedian(first[1][rows], axis=0)[:2] // 2.0
                yield (int(x), int(y)), gap


def sizes(annotations: Path, data: Path) -> None:
    """Sizes of the tracks of each camera, and how two cameras agree about those that both see."""
    print("\nMEVA sizes, m   tracks   length (10 to 90 %)  width  height      sigma")
    both: dict[str, list[list[_Sized]]] = {}
    for name in ("G328", "G341", "G424", "G506"):
        camera, every = meva_camera(data, name), []
        for path, boxes in meva_clips(annotations, camera, name):
            found = list(_sized(camera, boxes, int(path.split(".")[1][6:8])))
            every += found
            if name in ("G328", "G424"):
                both.setdefault(path[:16], []).append(found)
        size, sigma = (np.array([getattr(one, f) for one in every]) for f in ("size_m", "sigma_m"))
        low, middle, high = np.quantile(size, [0.1, 0.5, 0.9], axis=0)
        spread = " ".join(f"{one:.2f}" for one in np.median(sigma, axis=0))
        print(
            f"{name:14}{len(size):8}{middle[0]:9.2f} ({low[0]:.1f} to {high[0]:.1f})"
            f"{middle[1]:11.2f}{middle[2]:8.2f}   {spread}"
        )
    pairs = [pair for parts in both.values() if len(parts) == 2 for pair in _same(*parts)]
    size = np.array([[one.size_m for one in pair] for pair in pairs])
    sigma = np.array([[one.sigma_m for one in pair] for pair in pairs])
    z = np.log(size[:, 0] / size[:, 1]) / np.hypot(*np.moveaxis(sigma / size, 1, 0))
    alike = [np.corrcoef(size[:, 0, k], size[:, 1, k])[0, 1] for k in range(3)]
    print(f"G328 and G424: {len(size)} vehicles, rms of difference over sigma", end=" ")
    print(*np.sqrt((z**2).mean(axis=0)).round(2), "correlation", *np.round(alike, 2))


@dataclass(frozen=True, eq=False)
class _Sized:
    """A track and its size in the end."""

    time_s: np.ndarray
    xy_m: np.ndarray
    size_m: np.ndarray
    sigma_m: np.ndarray


def _sized(camera: Camera, boxes: Detections, start_s: int) -> Iterator[_Sized]:
    boxes = boxes.select((boxes.box_xyxy[:, 2:] > boxes.box_xyxy[:, :2]).all(axis=1))
    looks = looks_of(boxes, 5.0, MEVA_FPS)
    parts = list(follow(looks, Calibration.of_camera(camera), PERSON_HEIGHT_M, trusted=True))
    rows = Tracks.concatenate(parts)
    rows = rows.select(np.isfinite(rows.xy_m[:, 0]))
    for track in np.unique(rows.track):
        mine = rows.select(rows.track == track)
        mine = mine.select(np.argsort(mine.time_s))
        time_s = np.round(mine.time_s + start_s, 1)
        yield _Sized(time_s, mine.xy_m, mine.size_m[-1], mine.size_sigma_m[-1])


def _same(first: list[_Sized], second: list[_Sized]) -> Iterator[tuple[_Sized, _Sized]]:
    """Tracks of both cameras within 4 m of each other for three seconds."""
    for one in first:
        gaps = []
        for other in second:
            _, i, j = np.intersect1d(one.time_s, other.time_s, return_indices=True)
            if len(i) >= 15:
                gap = np.hypot(*np.median(one.xy_m[i] - other.xy_m[j], axis=0))
                gaps.append((gap, id(other), other))
        if gaps and min(gaps)[0] < 4.0:
            yield one, min(gaps)[2]


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--annotations", type=Path, help="MEVA's annotations, unpacked")
    parser.add_argument("--count", type=int, default=3000, help="drawn vehicles per camera")
    asked = parser.parse_args()
    synthetic(asked.count)
    speed()
    if asked.annotations:
        parked(asked.annotations, asked.data)
        two_cameras(asked.annotations, asked.data)
        sizes(asked.annotations, asked.data)


if __name__ == "__main__":
    main()
