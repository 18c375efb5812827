"""How often is a second ground level found, and how often where there is none?

    python -m benchmarks.levels [--crowds N]

Crowds walk over flat ground, over ground with a straight step of known height, and over flat ground
with what is mistaken for one: short people, or seated ones, in one corner. Cameras are drawn at
random, with lenses that are distorted and off centre. Errors are of the kind that real footage has:
of one sighting, of one place (correlated over half a metre), of one person, smooth over the
picture; legs are hidden now and then, for a stretch of the way. Who stands behind an edge, as seen
from the camera, is hidden by it.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.tables import markdown
from scene4d.calibration import solve_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Segments

SIZE = (1920, 1080)
PEOPLE = CalibrateOptions(orientation="people")
STEPS_M = (0.3, 0.5, 1.0, 1.5)
_TALLEST_M = 2.05
_MOST = 80  # sightings of one person
_PIXEL, _SIGHTING, _PLACE, _PERSON = 0.7, 0.02, 0.02, 0.012
_REACH_M = 0.5


@dataclass(frozen=True, eq=False)
class Ground:
    """Ground that is ``step_m`` higher where ``xy @ normal > offset``."""

    normal: np.ndarray
    offset: float
    step_m: float = 0.0

    def beyond(self, xy: np.ndarray) -> np.ndarray:
        return np.asarray(xy @ self.normal > self.offset)

    def at(self, xy: np.ndarray) -> np.ndarray:
        return self.step_m * self.beyond(xy)

    def shows(self, camera: Camera, xy: np.ndarray) -> np.ndarray:
        """Which ground points no edge hides from the camera."""
        z, centre, shown = self.at(xy), camera.centre_m, np.ones(len(xy), bool)
        for t in np.linspace(0.3, 0.995, 60) if self.step_m else ():
            on_ray = centre[2] + t * (z - centre[2])
            shown &= self.at(centre[:2] + t * (xy - centre[:2])) <= on_ray + 1e-9
        return shown


def _image(camera: Camera, xy: np.ndarray, z: np.ndarray | float) -> np.ndarray:
    return camera.project(np.column_stack([xy, np.broadcast_to(z, len(xy))]))[0]


def _fits(camera: Camera, xy: np.ndarray, z: np.ndarray | float) -> np.ndarray:
    foot, head = _image(camera, xy, z), _image(camera, xy, z + _TALLEST_M)
    last = np.array(SIZE) - 1
    with np.errstate(invalid="ignore"):
        inside = ((foot >= 0) & (foot <= last) & (head >= 0) & (head <= last)).all(axis=1)
        large = np.hypot(*(foot - head).T) > 25
        return inside & large & (np.hypot(*xy.T) < 10 * camera.height_m)


def draw_camera(rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """A camera under which people fit, and ground points where they do."""
    while True:
        half = float(np.hypot(*SIZE) / 2)
        focal = SIZE[0] / 2 / np.tan(np.radians(rng.uniform(25, 85)) / 2)
        corner = np.clip(rng.normal(0, 0.04), -0.09, 0.06)
        shift = rng.normal(0, 0.015, 2) * SIZE
        camera = Camera.from_pose(
            image_size=SIZE,
            focal_px=focal,
            tilt_rad=np.radians(rng.uniform(8, 45)),
            roll_rad=np.radians(rng.normal(0, 3)),
            height_m=float(np.exp(rng.uniform(np.log(2.8), np.log(15)))),
            distortion=(corner * (focal / half) ** 2, 0.0, 0.0, 0.0, 0.0),
            centre_uv=tuple((np.array(SIZE) - 1) / 2 + shift),
        )
        xy, valid = camera.locate(rng.uniform(0, 1, (400, 2)) * SIZE)
        xy = xy[valid]
        xy = xy[_fits(camera, xy, 0.0)]
        if len(xy) < 40:
            continue
        length = np.hypot(*(_image(camera, xy, 0.0) - _image(camera, xy, 1.7)).T)
        if np.median(length) < 0.35 * SIZE[1]:
            return camera, xy


def _length_errors(rng: np.random.Generator, n: int, step_m: float) -> np.ndarray:
    """Of one person: its own, of places, and of sightings."""
    place = np.empty(n)
    place[0], memory = rng.normal(), np.exp(-step_m / _REACH_M)
    for i in range(1, n):
        place[i] = memory * place[i - 1] + np.sqrt(1 - memory**2) * rng.normal()
    return _PERSON * rng.normal() + _PLACE * place + _SIGHTING * rng.normal(size=n)


def _left(rng: np.random.Generator, n: int) -> np.ndarray:
    """Share of a person that is seen: now and then the legs are hidden for some sightings."""
    left = np.ones(n)
    for start in np.flatnonzero(rng.random(n) < 0.033):
        left[start : start + rng.integers(1, 6)] = rng.uniform(0.4, 0.9)
    return left


def crowd(
    camera: Camera, places: np.ndarray, ground: Ground, rng: np.random.Generator,
    *, tracks: int, crossing: bool = True, small: Callable[[np.ndarray], float] | None = None,
) -> Segments:  # fmt: skip
    """People who walk straight between two of the places. ``small`` gives by how much somebody is
    shorter (m) from the way; one in twelve is a child.
    """
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    step_m = float(rng.choice([0.15, 0.3, 0.6]))
    for _ in range(200 * tracks):
        if len(parts) == tracks:
            break
        a, b = places[rng.integers(len(places), size=2)]
        far = float(np.hypot(*(b - a)))
        n = int(np.clip(far / step_m, 2, _MOST))
        xy = a + (b - a) * np.linspace(0, min(1.0, n * step_m / max(far, 1e-9)), n)[:, None]
        if not crossing and len(set(ground.beyond(xy))) > 1:
            continue
        xy = xy[_fits(camera, xy, ground.at(xy)) & ground.shows(camera, xy)]
        if len(xy) < 3:
            continue
        tall = rng.normal(1.70, 0.09) if rng.random() > 1 / 12 else rng.normal(1.25, 0.12)
        tall -= 0.0 if small is None else small(xy)
        z = ground.at(xy)
        foot, head = _image(camera, xy, z + 0.04), _image(camera, xy, z + tall)
        along = head - foot
        across = np.column_stack([-along[:, 1], along[:, 0]])
        n = len(xy)
        longer = _length_errors(rng, n, step_m)[:, None]
        head = head + longer * along + 0.03 * rng.normal(size=(n, 1)) * across
        foot, head = (end + _PIXEL * rng.normal(size=(n, 2)) for end in (foot, head))
        parts.append((head + _left(rng, n)[:, None] * (foot - head), head))
    foot, head = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    track = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    length = np.log(np.hypot(*(head - foot).T))
    aside = (foot[:, 0] - SIZE[0] / 2) / np.hypot(*SIZE) * 2
    smooth = 0.03 * rng.normal() * (length - np.median(length)) + 0.02 * rng.normal() * aside
    head = foot + np.exp(smooth)[:, None] * (head - foot)
    segments = Segments.from_points(foot, head, track=track)
    return replace(segments, frame=np.arange(len(foot)))


def _drawn(
    seed: int, step_m: float, *, tracks: int, crossing: bool = True, short_m: float = 0.0
) -> tuple[Calibration, float]:
    """A solved crowd, and the height of the step."""
    rng = np.random.default_rng(seed)
    camera, places = draw_camera(rng)
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle)])
    step_m *= rng.choice([-1, 1])
    if camera.height_m - step_m < 2.3:
        step_m = -abs(step_m)
    ground = Ground(normal, float(np.quantile(places @ normal, 0.65)), step_m)

    def small(xy: np.ndarray) -> float:
        return short_m * float(ground.beyond(xy).all())

    segments = crowd(
        camera, places, ground, rng, tracks=tracks, crossing=crossing and not short_m, small=small
    )
    return solve_segments(segments, SIZE, PEOPLE), step_m


def _row(name: str, step_m: float, crowds: int, **kind: object) -> list[str]:
    found, asked, error_m, sigma_m = 0, 0, [], []
    for seed in range(crowds):
        calibration, step = _drawn(seed, step_m, **kind)  # type: ignore[arg-type]
        asked += any("children" in text for text in calibration.warnings)
        for region in calibration.ground_regions:
            found += 1
            error_m.append(abs(abs(region.height_m) - abs(step)))
            sigma_m.append(region.sigma_m)
    rms = np.sqrt(np.mean((np.array(error_m) / sigma_m) ** 2)) if error_m else np.nan
    middle = np.median(error_m) if error_m else np.nan
    return [name, f"{found / crowds:.1%}", f"{asked / crowds:.1%}", f"{middle:.2f}", f"{rms:.2f}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--crowds", type=int, default=100)
    crowds = parser.parse_args().crowds
    rows = [["crowd", "level found", "asked about", "error (m)", "rms z"]]
    for tracks in (25, 60):
        rows.append(_row(f"flat, {tracks} people", 0.0, crowds, tracks=tracks))
        rows.append(_row(f"flat, short group, {tracks}", 0.0, crowds, tracks=tracks, short_m=0.4))
        rows += [_row(f"step of {z} m, {tracks}", z, crowds, tracks=tracks) for z in STEPS_M]
    print(markdown(rows))


if __name__ == "__main__":
    main()
