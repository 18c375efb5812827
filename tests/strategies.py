"""Whole cameras, lenses, ground points and crowds, for every test that needs them.

The Hypothesis strategies draw plain numbers and hand them to a builder, so that a failure shrinks
to a camera that a person can read. The crowds are deterministic: the caller brings the generator.
"""

import functools
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from scene4d.core.camera import Camera, Lens

ANY_TEXT = st.characters(exclude_categories=["Cs"])
"""Every character that UTF-8 can hold: asked for by codec, each process would try a million."""

SIZES = ((640, 480), (768, 576), (1280, 720), (1920, 1080), (720, 576), (1080, 1080))
TALLEST_M = 2.05
"""A place counts as visible where a person of this height fits the image."""
FOOT_HEIGHT_M = 0.04
SHORTEST_PX = 20.0
FARTHEST_HEIGHTS = 12.0
"""People stand at most this many camera heights away."""


def _builder(build: Callable[..., Any]) -> Callable[..., Any]:
    """Let a strategy call ``build``: beartype draws from ``random``, which Hypothesis forbids."""

    @functools.wraps(build)
    def undisturbed(*args: Any, **kwargs: Any) -> Any:
        state = random.getstate()
        try:
            return build(*args, **kwargs)
        finally:
            random.setstate(state)

    return undisturbed


@_builder
def build_lens(
    image_size: tuple[int, int] = (1280, 720),
    horizontal_fov_deg: float = 50.0,
    aspect: float = 1.0,
    centre_shift: tuple[float, float] = (0.0, 0.0),
    radial: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tangential: tuple[float, float] = (0.0, 0.0),
) -> Lens:
    """A lens in terms that do not depend on its focal length.

    ``aspect`` is fy / fx, ``centre_shift`` a fraction of the image, ``radial`` and ``tangential``
    what each coefficient moves the farthest corner by, as a fraction of that corner's radius.
    """
    width, height = image_size
    fx = width / 2 / np.tan(np.radians(horizontal_fov_deg) / 2)
    fy = fx * aspect
    du, dv = centre_shift
    cu, cv = (width - 1) / 2 + du * width, (height - 1) / 2 + dv * height
    r = np.hypot((0.5 + abs(du)) * width / fx, (0.5 + abs(dv)) * height / fy)
    k1, k2, k3 = np.array(radial) / r ** np.array([2, 4, 6])
    p1, p2 = np.array(tangential) / r
    return Lens(
        image_size=image_size,
        K=np.array([[fx, 0, cu], [0, fy, cv], [0, 0, 1]]),
        distortion=np.array([k1, k2, p1, p2, k3]),
    )


@_builder
def build_camera(
    lens: Lens | None = None,
    tilt_deg: float = 20.0,
    roll_deg: float = 0.0,
    height_m: float = 6.0,
    heading_deg: float = 0.0,
    xy_m: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """A camera over the ground; heading 0 and the origin are scene4d's own world."""
    lens = build_lens() if lens is None else lens
    seed = Camera.from_pose(
        image_size=lens.image_size,
        focal_px=1.0,
        tilt_rad=np.radians(tilt_deg),
        roll_rad=np.radians(roll_deg),
        height_m=1.0,
    )
    c, s = np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))
    R = seed.R @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    t = -R @ np.array([*xy_m, height_m])
    return lens.posed(R, t)


def least_height_m(lens: Lens, tilt_deg: float) -> float:
    """Camera height above which a person fits between the top and the bottom of the image.

    A person at depression θ (feet) reaches up to ``tan θ' = (1 - H / h) tan θ``; the feet at the
    bottom edge leave the most room. The factor makes room for more than one such place.
    """
    half = np.degrees(np.arctan(lens.image_size[1] / 2 / lens.K[1, 1]))
    low = np.tan(np.radians(tilt_deg - half))
    high = np.tan(np.radians(min(tilt_deg + half, 80.0)))
    room = 1 - max(low, 0.0) / high
    return float(np.clip(1.5 * TALLEST_M / room, 2.0, 20.0))


@_builder
def build_camera_over_people(
    lens: Lens, tilt_deg: float, roll_deg: float, height_fraction: float
) -> Camera:
    """As :func:`build_camera`, at a height between the least where people fit and 20 m."""
    least = least_height_m(lens, tilt_deg)
    return build_camera(lens, tilt_deg, roll_deg, least + height_fraction * (20.0 - least))


def lenses(*, distorted: bool = True, square: bool = False) -> st.SearchStrategy[Lens]:
    """Lenses of 15 to 90 degrees, whose distortion does not fold inside the image.

    ``square``: square pixels and the principal point at the image centre, as scene4d assumes.
    """
    zero = st.just(0.0)
    return st.builds(
        build_lens,
        image_size=st.sampled_from(SIZES),
        horizontal_fov_deg=st.floats(15.0, 90.0),
        aspect=st.just(1.0) if square else st.floats(0.9, 1.1),
        centre_shift=st.tuples(zero, zero)
        if square
        else st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
        radial=st.tuples(st.floats(-0.08, 0.1), st.floats(-0.015, 0.015), st.floats(-0.005, 0.005))
        if distorted
        else st.tuples(zero, zero, zero),
        tangential=st.tuples(st.floats(-0.002, 0.002), st.floats(-0.002, 0.002))
        if distorted
        else st.tuples(zero, zero),
    )


@_builder
def build_fisheye(
    image_size: tuple[int, int] = (1280, 960),
    focal_px: float = 400.0,
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    aspect: float = 1.0,
    skew: float = 0.0,
    centre_shift: tuple[float, float] = (0.0, 0.0),
) -> Lens:
    """A fisheye lens, with its principal point off the middle by ``centre_shift`` pixels."""
    width, height = image_size
    cu, cv = (width - 1) / 2 + centre_shift[0], (height - 1) / 2 + centre_shift[1]
    K = np.array([[focal_px, skew, cu], [0, focal_px * aspect, cv], [0, 0, 1]])
    return Lens(image_size, K, np.array(distortion), distortion_model="fisheye")


def fisheye_lenses() -> st.SearchStrategy[Lens]:
    """Fisheye lenses whose curve grows up to 95 degrees and more."""
    shift = st.floats(-30.0, 30.0)
    return st.builds(
        build_fisheye,
        focal_px=st.floats(200.0, 900.0),
        distortion=st.tuples(
            st.floats(-0.06, 0.1), st.floats(-0.004, 0.01), st.floats(-2e-4, 1e-3), st.just(1e-4)
        ),
        aspect=st.floats(0.9, 1.1),
        skew=st.floats(-5.0, 5.0),
        centre_shift=st.tuples(shift, shift),
    )


def cameras(
    lens: st.SearchStrategy[Lens] | None = None, *, anywhere: bool = False
) -> st.SearchStrategy[Camera]:
    """Cameras tilted 5 to 60 degrees, rolled by up to 20, 2 to 20 m above the ground.

    ``anywhere``: any heading and position; otherwise scene4d's own world.
    """
    zero = st.just(0.0)
    return st.builds(
        build_camera,
        lens=lenses() if lens is None else lens,
        tilt_deg=st.floats(5.0, 60.0),
        roll_deg=st.floats(-20.0, 20.0),
        height_m=st.floats(2.0, 20.0),
        heading_deg=st.floats(-180.0, 180.0) if anywhere else zero,
        xy_m=st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
        if anywhere
        else st.tuples(zero, zero),
    )


def cameras_over_people(
    lens: st.SearchStrategy[Lens] | None = None, *, max_roll_deg: float = 20.0
) -> st.SearchStrategy[Camera]:
    """Cameras high enough that whole people fit the image: those for :func:`people_scene`."""
    return st.builds(
        build_camera_over_people,
        lens=lenses(distorted=False, square=True) if lens is None else lens,
        tilt_deg=st.floats(5.0, 60.0),
        roll_deg=st.floats(-max_roll_deg, max_roll_deg),
        height_fraction=st.floats(0.0, 1.0),
    )


def ground_in_view(camera: Camera, fractions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ground points ``xyz_m`` (Z = 0) seen at (n, 2) fractions of the image below the horizon.

    Also their undistorted pixels. Found by walking along the ray, not by ``locate``.
    """
    width, height = camera.image_size
    K_inverse, up = np.linalg.inv(camera.K), camera.R[:, 2]
    # Rays that sink by at least 1 in 50: up · K⁻¹ (u, v, 1) <= -0.02 bounds v from above.
    u = fractions[:, 0] * (width - 1)
    row = up @ K_inverse
    top = np.maximum((-0.02 - row[0] * u - row[2]) / row[1], 0.0)
    v = top + fractions[:, 1] * (height - 1 - top)
    ray = np.column_stack([u, v, np.ones_like(u)]) @ K_inverse.T @ camera.R
    centre = -camera.R.T @ camera.t
    return centre - ray * (centre[2] / ray[:, 2])[:, None], np.column_stack([u, v])


@st.composite
def views(draw, camera: st.SearchStrategy[Camera] | None = None):
    """A camera, ground points in its view ``xyz_m`` and their undistorted pixels."""
    seen = draw(cameras(anywhere=True) if camera is None else camera)
    unit = st.floats(0.0, 1.0)
    fractions = draw(st.lists(st.tuples(unit, unit), min_size=1, max_size=8))
    return seen, *ground_in_view(seen, np.array(fractions))


@dataclass(frozen=True, eq=False)
class PeopleScene:
    """Upright people as a perfect tracker would report them, and the truth about each row."""

    foot_uv: np.ndarray
    head_uv: np.ndarray
    track: np.ndarray
    height_m: np.ndarray
    xy_m: np.ndarray
    outlier: np.ndarray

    def __len__(self) -> int:
        return len(self.track)


def _image(camera: Camera, xy_m: np.ndarray, z_m, distorted: bool) -> np.ndarray:
    """Pixels of points at heights ``z_m`` over ``xy_m``; NaN where they have none."""
    xyz_m = np.column_stack([xy_m, np.broadcast_to(z_m, len(xy_m))])
    return camera.project(xyz_m, undistorted=not distorted)[0]


def _fits(camera: Camera, xy_m: np.ndarray, distorted: bool) -> np.ndarray:
    """Where a person of ``TALLEST_M`` is wholly in the image, near and large enough."""
    foot = _image(camera, xy_m, FOOT_HEIGHT_M, distorted)
    head = _image(camera, xy_m, TALLEST_M, distorted)
    last = np.array(camera.image_size) - 1
    inside = ((foot >= 0) & (foot <= last) & (head >= 0) & (head <= last)).all(axis=1)
    centre = camera.centre_m
    near = np.hypot(*(xy_m - centre[:2]).T) < FARTHEST_HEIGHTS * centre[2]
    return inside & near & (np.hypot(*(foot - head).T) > SHORTEST_PX)


def _places(camera: Camera, n: int, rng: np.random.Generator, distorted: bool) -> np.ndarray:
    """Ground positions where people fit, spread evenly over the image."""
    found, count = [], 0
    for _ in range(60):
        uv = rng.uniform(0, np.array(camera.image_size) - 1, (4 * n + 100, 2))
        xy, valid = camera.locate(uv, FOOT_HEIGHT_M, undistorted=not distorted)
        xy = xy[valid]
        found.append(xy[_fits(camera, xy, distorted)])
        count += len(found[-1])
        if count >= n:
            return np.concatenate(found)[:n]
    raise ValueError(f"only {count} of {n} people of {TALLEST_M} m fit the view of {camera}")


def _walks(
    camera: Camera, n: int, tracks: int, rng: np.random.Generator, distorted: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Straight walks of 1 m a sighting; ``(xy_m, track)``.

    The places where a person fits are convex on the ground, but for the lens and the shortest
    length, so a walk between two of them stays inside; the few that do not are drawn again.
    """
    track = np.sort(np.arange(n) % tracks)
    first = np.searchsorted(track, np.arange(tracks))
    steps = np.bincount(track, minlength=tracks)
    ends = _places(camera, 2 * tracks, rng, distorted).reshape(tracks, 2, 2)
    for _ in range(60):
        way = ends[:, 1] - ends[:, 0]
        stride = way / np.maximum(np.hypot(*way.T), steps)[:, None]
        xy = ends[track, 0] + (np.arange(n) - first[track])[:, None] * stride[track]
        bad = np.unique(track[~_fits(camera, xy, distorted)])
        if not len(bad):
            return xy, track
        ends[bad] = _places(camera, 2 * len(bad), rng, distorted).reshape(-1, 2, 2)
    raise ValueError(f"{len(bad)} of {tracks} walks do not fit the view of {camera}")


def people_scene(
    camera: Camera,
    n: int,
    rng: np.random.Generator,
    *,
    height_sigma: float = 0.09,
    mean_height_m: float = 1.70,
    noise: float = 0.02,
    noise_px: float = 1.0,
    outliers: float = 0.0,
    tracks: int | None = None,
    distorted: bool = False,
) -> PeopleScene:
    """``n`` sightings of upright people: feet at Z = 0.04 m, head at the person's height.

    Places are chosen by whether someone of 2.05 m would fit, before any height is drawn: the view
    selects nobody by height. ``noise`` moves the head along the person by that fraction of its
    length (1.5 times as much across: people lean and sway), ``noise_px`` moves both ends.
    ``outliers`` is the fraction of sightings whose legs are hidden: the foot lies at 0.3 to 0.85
    of the length from the head. ``tracks`` people walk, one height each (None: every sighting is
    another person). Pixels are undistorted unless ``distorted``.
    """
    if tracks is None:
        xy, track = _places(camera, n, rng, distorted), np.arange(n)
    else:
        xy, track = _walks(camera, n, tracks, rng, distorted)
    height = rng.normal(mean_height_m, height_sigma, track.max(initial=0) + 1)[track]
    foot = _image(camera, xy, FOOT_HEIGHT_M, distorted)
    head = _image(camera, xy, height, distorted)
    along = head - foot
    across = np.column_stack([-along[:, 1], along[:, 0]])
    sway = noise * rng.normal(size=(n, 2)) * [1.0, 1.5]
    head = head + sway[:, :1] * along + sway[:, 1:] * across + noise_px * rng.normal(size=(n, 2))
    foot = foot + noise_px * rng.normal(size=(n, 2))
    outlier = np.zeros(n, bool)
    outlier[rng.permutation(n)[: round(outliers * n)]] = True
    left = np.where(outlier, rng.uniform(0.3, 0.85, n), 1.0)[:, None]
    return PeopleScene(head + left * (foot - head), head, track, height, xy, outlier)
