"""Small sites whose truth is known: people and vehicles who walk through the views of cameras.

A world is made in the site's metres and clock; every camera sees what is in its circle of ground,
in its own metres and on its own clock, with noise of its own for each row and one error that all of
its rows share. Tracks break now and then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from made_tracks import made_tracks
from scene4d.core.calibration import Calibration
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks
from scene4d.store.site_file import SiteCamera
from scene4d.store.writing import SceneWriter
from strategies import build_camera, build_lens

FPS = 10.0
NOON = datetime(2026, 11, 20, 12, tzinfo=UTC)
CAMERA = build_camera(build_lens((1280, 720), 70.0), 25.0, 0.0, 5.0)


@dataclass(frozen=True)
class Eye:
    """A camera of a world: its place, the ground that it sees (middle and radius, in the site's
    metres), and the standard deviations of what a row errs by and of what all rows err by.
    """

    name: str
    placement: Placement
    middle_m: tuple[float, float]
    radius_m: float
    noise_m: float = 0.1
    shared_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Walker:
    """Somebody on the ground of the site: positions (n, 2) at ``time_s`` (n,)."""

    time_s: np.ndarray
    xy_m: np.ndarray
    kind: str = "person"
    height_m: float = 1.7


def place(x: float, y: float, heading_deg: float, scale: float = 1.0, offset_s: float = 0.0):
    return Placement(float(x), float(y), float(np.radians(heading_deg)), scale, offset_s)


def strolls(n: int, seconds: float, extent_m: float, seed: int = 0) -> list[Walker]:
    """People who begin here and there, now and then, and turn a little as they go."""
    rng = np.random.default_rng(seed)
    walkers = []
    for _ in range(n):
        steps = int(rng.uniform(15, 30) * FPS)
        begin = rng.uniform(0, seconds - steps / FPS)
        angle = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0, 0.02, steps))
        speed = rng.uniform(0.9, 1.6)
        way = speed / FPS * np.column_stack([np.cos(angle), np.sin(angle)])
        xy = np.cumsum(way, axis=0)
        xy += rng.uniform(-extent_m, extent_m, 2) - xy[steps // 2]
        time_s = np.round(begin * FPS) / FPS + np.arange(steps) / FPS
        walkers.append(Walker(time_s, xy, height_m=float(rng.normal(1.7, 0.09))))
    return walkers


def seen(
    eye: Eye, walkers: Sequence[Walker], seed: int = 0, breaks: float = 0.0
) -> tuple[Tracks, dict[int, int]]:
    """What a camera tracks, in its own frame, and whose track each is.

    A row differs from the truth by ``noise_m``, all rows by one draw of ``shared_m``. A track ends
    and another begins with probability ``breaks`` a second.
    """
    rng = np.random.default_rng([seed, *eye.name.encode()])
    back = eye.placement.inverse()
    bias = rng.normal(0, 1, 2) * eye.shared_m
    parts, whose = [], {}
    for who, walker in enumerate(walkers):
        inside = np.hypot(*(walker.xy_m - eye.middle_m).T) < eye.radius_m
        cut = inside & (rng.random(len(inside)) < breaks / FPS)
        piece = np.cumsum(np.diff(inside, prepend=False) | cut)
        for number in np.unique(piece[inside]):
            rows = np.flatnonzero(inside & (piece == number) & ~cut)
            if len(rows) < 5:
                continue
            track = len(whose) + 1
            whose[track] = who
            error = bias + rng.normal(0, eye.noise_m, (len(rows), 2))
            parts.append(_rows(eye, back, walker, rows, track, error, rng))
    tracks = Tracks.concatenate(parts)
    return tracks.select(np.lexsort((tracks.time_s, tracks.track))), whose


def _rows(eye, back, walker, rows, track, error, rng) -> Tracks:
    velocity = np.gradient(walker.xy_m, 1 / FPS, axis=0)[rows]
    xy = back.points(walker.xy_m[rows] + error)
    own = back.velocities(velocity)
    height = walker.height_m * back.scale + rng.normal(0, 0.04)
    return made_tracks(
        track, back.times(walker.time_s[rows]), xy, class_name=walker.kind,
        frame=np.rint(walker.time_s[rows] * FPS).astype(int),
        covariance_m2=(eye.noise_m * back.scale) ** 2,
        shared_covariance_m2=(eye.shared_m * back.scale) ** 2, velocity_mps=own,
        velocity_covariance=0.1**2, heading_sigma_rad=0.2, box_xyxy=[100.0, 100.0, 140.0, 220.0],
        size_m=[np.nan, np.nan, height], size_sigma_m=[np.nan, np.nan, 0.05],
    )  # fmt: skip


def store(
    folder: Path, eye: Eye, tracks: Tracks, start: datetime | None = None, run: str = "r"
) -> SiteCamera:
    """The scene of a camera on disk, and its entry in a site."""
    rows = tracks.select(np.lexsort((tracks.track, tracks.time_s)))
    rows = replace(rows, time_s=rows.time_s)
    calibration = Calibration.of_camera(CAMERA)
    with SceneWriter(
        folder,
        camera=eye.name,
        run=run,
        start_utc=start,
        camera_json=calibration.to_dict(),
        provenance={},
    ) as writer:
        writer.write(rows)
    file = folder / "cameras" / f"{eye.name}.json"
    tracked = {run: writer.run.tracked()}
    return SiteCamera(folder, file, eye.name, (run,), eye.placement, tracked)
