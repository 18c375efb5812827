"""People that no camera over one flat ground sees, and what a camera over flat ground sees of them.

Every scene is (camera, segments); ``camera`` is None where none sees this.
"""

from dataclasses import replace

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, people_scene

SIZE = (1280, 720)
CAMERA = build_camera(build_lens(SIZE, 55.0), 22.0, 1.0, 6.0)
STEPS = 6
"""Sightings of each person."""


def segments(foot_uv, head_uv, track, frame=None) -> Segments:
    """Points with tracks; each sighting has a frame of its own unless told."""
    found = Segments.from_points(foot_uv, head_uv, track=np.asarray(track))
    frame = np.arange(len(track)) if frame is None else np.asarray(frame)
    return replace(found, frame=frame, time_s=frame.astype(float))


def walkers(people: int, seed: int, camera: Camera = CAMERA) -> Segments:
    """An ordinary scene."""
    rng = np.random.default_rng([seed, 7])
    seen = people_scene(camera, people * STEPS, rng, tracks=people, noise=0.02, noise_px=0.7)
    return segments(seen.foot_uv, seen.head_uv, seen.track)


def joined(*groups: Segments) -> Segments:
    """Groups of different people in one clip."""
    shifted, first = [], 0
    for group in groups:
        shifted.append(replace(group, track=group.track + first))
        first += int(group.track.max()) + 1
    both = Segments.joined(shifted)
    return replace(both, frame=np.arange(len(both)), time_s=np.arange(float(len(both))))


def standing(camera: Camera, xy_m, seed: int, heights_m=1.70, base_m=0.0, lean=0.0) -> Segments:
    """People (p, s, 2) at places on the ground, of ``heights_m``, whose feet stand ``base_m`` above
    it and who lean by ``lean`` (tangent) towards +X."""
    rng = np.random.default_rng([seed, 11])
    p, s, _ = xy_m.shape
    xy = xy_m.reshape(-1, 2)
    track = np.repeat(np.arange(p), s)
    tall = (rng.normal(0, 0.07, p) + heights_m)[track]
    base = np.broadcast_to(base_m, (p, s)).reshape(-1)
    top = xy + np.column_stack([lean * tall, np.zeros(len(xy))])
    foot = camera.project(np.column_stack([xy, base + 0.04]))[0]
    head = camera.project(np.column_stack([top, base + tall]))[0]
    length = np.hypot(*(foot - head).T)[:, None]
    head = head + 0.02 * length * rng.normal(size=head.shape)
    foot, head = (uv + 0.7 * rng.normal(size=uv.shape) for uv in (foot, head))
    inside = np.all([(uv > 0) & (uv < SIZE) for uv in (foot, head)], axis=(0, 2))
    return segments(foot, head, track).select(inside)


def walks(people: int, seed: int, camera: Camera = CAMERA) -> np.ndarray:
    """Straight walks (p, STEPS, 2) on the ground in view."""
    rng = np.random.default_rng([seed, 7])
    seen = people_scene(camera, people * STEPS, rng, tracks=people)
    return seen.xy_m.reshape(people, STEPS, 2)


# --- no camera over one flat ground ---


def cut_outs(people: int, seed: int, spread: float = 0.5) -> Segments:
    """Upright people of random size at random places; each keeps its size while it moves."""
    rng = np.random.default_rng([seed, 13])
    start = rng.uniform([60, 250], [1220, 700], (people, 1, 2))
    foot = start + np.cumsum(rng.normal(0, 15, (people, STEPS, 2)), axis=1)
    size = 110 * np.exp(rng.normal(0, spread, people))[:, None]
    head = foot - np.stack([rng.normal(0, 0.04, foot.shape[:2]) * size, size + 0 * foot[..., 0]], 2)
    track = np.repeat(np.arange(people), STEPS)
    return segments(foot.reshape(-1, 2), head.reshape(-1, 2), track)


def one_person(seed: int, sightings: int = 60) -> Segments:
    """One person who walks about."""
    rng = np.random.default_rng([seed, 17])
    bends = np.array([[-3, 9], [4, 14], [-4, 20], [3, 26]]) + rng.normal(0, 1, (4, 2))
    at = np.linspace(0, 3, sightings)
    xy = np.column_stack([np.interp(at, range(4), bends[:, k]) for k in (0, 1)])
    return standing(CAMERA, xy[None], seed)


def one_spot(seed: int, sightings: int = 60, tracks: int = 3) -> Segments:
    """A thing that is taken for a person over and over, under several numbers."""
    rng = np.random.default_rng([seed, 19])
    foot = np.array([640, 500]) + rng.normal(0, 1.5, (sightings, 2))
    head = np.array([642, 380]) + rng.normal(0, 1.5, (sightings, 2))
    return segments(foot, head, np.arange(sightings) * tracks // sightings)


def porch(seed: int) -> Segments:
    """Four sightings of two people near one door."""
    xy = np.array([[[0.5, 7.0], [0.9, 7.6]], [[-0.6, 8.4], [0.2, 9.0]]])
    return standing(CAMERA, xy, seed)


def contradicting(people: int, seed: int, apart: str = "mixed") -> Segments:
    """Two halves, each of which another camera sees; ``apart`` in the picture or mixed."""
    other = build_camera(build_lens(SIZE, 30.0), 10.0, -4.0, 3.5)
    both = [walkers(people // 2, seed), walkers(people // 2, seed + 1, other)]
    if apart == "sides":
        both = [
            group.select((group.foot_uv[:, 0] < 640) == left)
            for group, left in zip(both, (True, False), strict=True)
        ]
    return joined(*both)


def screen(people: int, seed: int, at_xyxy=(900, 100, 1220, 280), real: int = 0) -> Segments:
    """People on a television, and ``real`` ones in the room."""
    shown = walkers(people, seed)
    corner, scale = np.array(at_xyxy[:2]), (at_xyxy[2] - at_xyxy[0]) / SIZE[0]
    shown = replace(
        shown, foot_uv=corner + scale * shown.foot_uv, head_uv=corner + scale * shown.head_uv
    )
    room = build_camera(build_lens(SIZE, 75.0), 15.0, 0.0, 2.6)
    return joined(walkers(real, seed + 50, room), shown) if real else shown
