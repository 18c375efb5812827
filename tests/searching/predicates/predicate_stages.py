"""Small stages made by hand, and the same motion as random cameras see it."""

from dataclasses import dataclass, replace

import numpy as np

from scene4d.core.body import HALPE26
from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.searching.predicates._spots import Spots, SpotTable
from scene4d.searching.predicates._when import When
from scene4d.searching.predicates.stage import Stage, StageRows

STEP_S = 0.2


@dataclass(frozen=True, eq=False)
class Path:
    """Where one object truly is: one row per moment. Boxes and keypoints are optional, and so is
    how tall it is, for views to make boxes of.
    """

    time_s: np.ndarray
    xy_m: np.ndarray
    velocity_mps: np.ndarray
    heading_rad: np.ndarray | None = None
    heading_sigma_rad: float = 0.1
    name: str = "person"
    box_xyxy: np.ndarray | None = None
    keypoint_uv: np.ndarray | None = None
    height_m: np.ndarray | None = None
    sigma_m: float = 0.05
    sigma_mps: float = 0.05

    def __len__(self) -> int:
        return len(self.time_s)


def straight(start, velocity, seconds=4.0, begin_s=0.0, **more) -> Path:
    time = begin_s + np.arange(0.0, seconds + STEP_S / 2, STEP_S)
    velocity = np.asarray(velocity, float)
    xy = np.asarray(start, float) + (time - begin_s)[:, None] * velocity
    return Path(time, xy, np.tile(velocity, (len(time), 1)), **more)


def arc(speed, turn_radps, seconds=4.0, start=(0.0, 0.0), course_rad=0.0, **more) -> Path:
    """A circle at constant speed; positive turns are to the left."""
    time = np.arange(0.0, seconds + STEP_S / 2, STEP_S)
    course = course_rad + turn_radps * time
    velocity = speed * np.column_stack([np.cos(course), np.sin(course)])
    turned = np.column_stack([np.sin(course), -np.cos(course)])
    xy = np.asarray(start, float) + speed / turn_radps * (turned - turned[0])
    return Path(time, xy, velocity, **more)


def stage_of(*paths: Path, size=(1280, 720), step_s=STEP_S, factor=None, **places) -> Stage:
    n = sum(map(len, paths))
    joints = max((0 if p.keypoint_uv is None else p.keypoint_uv.shape[1] for p in paths), default=0)

    def column(value, width) -> np.ndarray:
        parts = []
        for p in paths:
            found = value(p)
            parts.append(np.full((len(p), *width), np.nan) if found is None else found)
        return np.concatenate(parts) if parts else np.empty((0, *width))

    box = column(lambda p: p.box_xyxy, (4,))
    tracks = Tracks(
        track=np.repeat(np.arange(len(paths)) + 1, [len(p) for p in paths]),
        class_name=np.repeat([p.name for p in paths], [len(p) for p in paths]).astype(str),
        time_s=column(lambda p: p.time_s, ()),
        frame=np.rint(column(lambda p: p.time_s, ()) / STEP_S).astype(int),
        xy_m=column(lambda p: p.xy_m, (2,)),
        covariance_m2=column(lambda p: np.tile(p.sigma_m**2 * np.eye(2), (len(p), 1, 1)), (2, 2)),
        shared_covariance_m2=np.zeros((n, 2, 2)),
        velocity_mps=column(lambda p: p.velocity_mps, (2,)),
        velocity_covariance=column(
            lambda p: np.tile(p.sigma_mps**2 * np.eye(2), (len(p), 1, 1)), (2, 2)
        ),
        heading_rad=column(lambda p: p.heading_rad, ()),
        heading_sigma_rad=column(
            lambda p: np.full(len(p), np.nan if p.heading_rad is None else p.heading_sigma_rad), ()
        ),
        box_xyxy=box,
        keypoint_uv=column(lambda p: p.keypoint_uv, (joints, 2)),
        keypoint_score=np.isfinite(column(lambda p: p.keypoint_uv, (joints, 2)))
        .all(axis=2)
        .astype(float),
        score=np.ones(n),
        observed=np.ones(n, bool),
    )
    return Stage(tracks, size, step_s, factor, **places)


def rows_of(stage: Stage, track: int) -> StageRows:
    return stage.rows(np.flatnonzero(stage.tracks.track == track))


def one(xy=(0.0, 0.0), velocity=(0.0, 0.0), heading=None, **more) -> Path:
    """A single moment."""
    return Path(
        np.zeros(1),
        np.asarray([xy], float),
        np.asarray([velocity], float),
        None if heading is None else np.array([heading]),
        **more,
    )


def drawn(path: Path, count: int, rng: np.random.Generator) -> Path:
    """So many draws of a single moment within its stated errors, as rows of one path."""
    ones = np.ones((count, 1))
    heading = path.heading_rad
    if heading is not None:
        heading = heading + path.heading_sigma_rad * rng.normal(size=count)
    return replace(
        path,
        time_s=np.arange(count) * STEP_S,
        xy_m=ones * path.xy_m + path.sigma_m * rng.normal(size=(count, 2)),
        velocity_mps=ones * path.velocity_mps + path.sigma_mps * rng.normal(size=(count, 2)),
        heading_rad=heading,
    )


def standing_body(height_m: float, left_wrist_m, right_wrist_m=(0.0, -0.25, 0.82)) -> np.ndarray:
    """Halpe keypoints (26, 3) of a person at the origin who faces +X; wrists where they are said,
    for a person of 1.70 m.
    """
    at = {
        "ankle": (0.0, 0.1, 0.05), "hip": (0.0, 0.14, 0.90), "shoulder": (0.0, 0.17, 1.40),
        "elbow": (0.0, 0.22, 1.1), "wrist": (0.0, 0.25, 0.82), "knee": (0.0, 0.1, 0.48),
        "eye": (0.08, 0.03, 1.6), "ear": (0.0, 0.08, 1.6), "heel": (-0.05, 0.1, 0.03),
        "big_toe": (0.15, 0.1, 0.02), "small_toe": (0.12, 0.14, 0.02),
    }  # fmt: skip
    middle = {
        "nose": (0.1, 0.0, 1.57), "head_top": (0.0, 0.0, 1.665),
        "neck": (0.0, 0.0, 1.42), "pelvis": (0.0, 0.0, 0.9),
    }  # fmt: skip
    points = []
    for name in HALPE26:
        side, _, part = name.partition("_")
        if name in middle:
            points.append(middle[name])
        else:
            x, y, z = at[part]
            points.append((x, y if side == "left" else -y, z))
    points[HALPE26.index("left_wrist")] = tuple(left_wrist_m)
    points[HALPE26.index("right_wrist")] = tuple(right_wrist_m)
    return np.array(points) * height_m / 1.70


@dataclass(frozen=True, eq=False)
class View:
    """A camera, and the rigid motion that puts the made-up world before it."""

    camera: Camera
    turn_rad: float
    shift_m: np.ndarray

    @property
    def rotation(self) -> np.ndarray:
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.array([[c, -s], [s, c]])

    def placed(self, xyz_m: np.ndarray) -> np.ndarray:
        xy = xyz_m[..., :2] @ self.rotation.T + self.shift_m
        return np.concatenate([xy, xyz_m[..., 2:]], axis=-1)

    def pixels(self, xyz_m: np.ndarray) -> np.ndarray:
        """Pixels of the footage (distorted) of points of the made-up world."""
        uv, valid = self.camera.project(self.placed(xyz_m).reshape(-1, 3))
        assert valid.all()
        return uv.reshape(*xyz_m.shape[:-1], 2)

    def located(self, uv: np.ndarray) -> np.ndarray:
        xy, valid = self.camera.locate(uv)
        assert valid.all()
        return xy

    def ground_covariance(self, uv: np.ndarray, sigma_px: float) -> np.ndarray:
        step = 0.5
        columns = [
            (self.located(uv + step * e) - self.located(uv - step * e)) / (2 * step)
            for e in np.eye(2)
        ]
        jacobian = np.stack(columns, axis=-1)
        return sigma_px**2 * jacobian @ jacobian.swapaxes(1, 2)


def random_view(rng: np.random.Generator, max_tilt_deg: float = 50.0) -> View:
    """A camera of its own world, 5 to 12 m up, that looks at a place 10 to 40 m away."""
    height, tilt = rng.uniform(5.0, 12.0), np.radians(rng.uniform(15.0, max_tilt_deg))
    distance = height / np.tan(tilt)
    camera = Camera.from_pose(
        image_size=(1920, 1080),
        focal_px=float(rng.uniform(0.8, 1.2) * 1920 * max(0.5, distance / 30)),
        tilt_rad=float(tilt),
        roll_rad=float(np.radians(rng.uniform(-8, 8))),
        height_m=float(height),
        distortion=(rng.uniform(-0.05, 0.05), 0.0, 0.0, 0.0, 0.0),
    )
    return View(camera, rng.uniform(-np.pi, np.pi), np.array([0.0, distance]))


def seen_stage(
    view: View, *paths: Path, rng: np.random.Generator | None = None, sigma_px: float = 0.01
) -> Stage:
    """What a view makes of the paths: positions by way of pixels, with their covariances, and boxes
    around the upright bodies of those that have a height.

    With ``rng`` everything is drawn with the errors that it is said to have: pixels, velocities
    (as of a line through a second of positions), headings, the edges of boxes.
    """
    out, covariances, velocity_covariances = [], [], []
    for p in paths:
        n = len(p)
        uv = view.pixels(np.column_stack([p.xy_m, np.zeros(n)]))
        covariance = view.ground_covariance(uv, sigma_px)
        of_velocity = covariance * 2.0
        velocity, heading = p.velocity_mps @ view.rotation.T, p.heading_rad
        if heading is not None:
            heading = heading + view.turn_rad
        if rng is not None:
            uv = uv + sigma_px * rng.normal(size=uv.shape)
            root = np.linalg.cholesky(of_velocity)
            velocity = velocity + (root @ rng.normal(size=(n, 2, 1)))[:, :, 0]
            if heading is not None:
                heading = heading + p.heading_sigma_rad * rng.normal(size=n)
        moved = replace(p, xy_m=view.located(uv), velocity_mps=velocity, heading_rad=heading)
        out.append(
            moved if p.height_m is None else replace(moved, box_xyxy=body_boxes(view, p, rng))
        )
        covariances.append(covariance)
        velocity_covariances.append(of_velocity)
    stage = stage_of(*out, size=view.camera.image_size)
    tracks = replace(
        stage.tracks,
        covariance_m2=np.concatenate(covariances),
        velocity_covariance=np.concatenate(velocity_covariances),
    )
    return replace(stage, tracks=tracks, camera=view.camera)


def body_boxes(view: View, path: Path, rng: np.random.Generator | None = None) -> np.ndarray:
    """Boxes from head to foot of somebody thin and upright, half as wide as tall; with ``rng`` the
    upper and lower edges are off by 2 % of the box, and at least by a pixel.
    """
    foot, head = (
        view.pixels(np.column_stack([path.xy_m, z])) for z in (np.zeros(len(path)), path.height_m)
    )
    top, bottom = head[:, 1], foot[:, 1]
    tall = bottom - top
    if rng is not None:
        edge = np.maximum(0.02 * tall, 1.0)
        top, bottom = (v + edge * rng.normal(size=len(path)) for v in (top, bottom))
    left = (foot[:, 0] + head[:, 0]) / 2 - tall / 4
    return np.column_stack([left, top, left + tall / 2, bottom])


def with_spots(stage: Stage, name: str, rng: np.random.Generator, n: int = 5) -> Stage:
    """The stage with spots of others, at any times about its own."""
    times = stage.tracks.time_s
    begin_s = rng.uniform(times.min() - 5, times.max() + 5, n)
    table = SpotTable(
        xy_m=rng.normal(size=(n, 2)),
        covariance_m2=np.tile(0.1 * np.eye(2), (n, 1, 1)),
        begin_s=begin_s,
        end_s=begin_s + rng.uniform(0, 3, n),
        clock=np.zeros(n, int),
        frame=np.zeros(n, int),
        run=np.zeros(n, int),
        track=np.arange(n) % 3 + 1,
        score=rng.uniform(0.1, 1, n),
    )
    span_s = (float(times.min()), float(times.max()))
    spots = Spots(table, When(), run=0, start_s=0.0, span_s=span_s, factor=stage.camera_factor)
    return replace(stage, spots={name: spots})
