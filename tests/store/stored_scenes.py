"""Tracks to be stored, and scenes of them on disk."""

from dataclasses import fields
from datetime import UTC, datetime

import numpy as np

from scene4d.core.tracks import CLASSES, Tracks
from scene4d.store.writing import SceneWriter

NOON = datetime(2009, 6, 1, 12, tzinfo=UTC)
CAMERA = {"schema": "scene4d/camera/1", "focal_px": 1200.5, "distortion": [0.0, -0.1]}


def walk(n: int, *, seed: int = 0, objects: int = 7, keypoints: int = 3, start_s: float = 0.0):
    """Tracks of ``objects`` at 10 frames a second, seen nine times out of ten; ``n`` rows."""
    rng = np.random.default_rng(seed)
    track = np.sort(rng.integers(0, objects, n))
    frame = np.concatenate([np.arange(np.sum(track == t)) for t in range(objects)])
    observed = rng.random(n) < 0.9
    box = rng.uniform(0, 700, (n, 4))
    box[~observed] = np.nan
    person = track % 2 == 0
    uv = rng.uniform(0, 700, (n, keypoints, 2)).astype(np.float32).astype(float)
    uv[~(observed & person)] = np.nan
    uv[rng.random((n, keypoints)) < 0.1] = np.nan
    score = rng.random((n, keypoints)).astype(np.float32).astype(float)
    score[np.isnan(uv).all(axis=(1, 2))] = 0.0
    return Tracks(
        track=track,
        class_name=np.where(person, "person", "car"),
        time_s=start_s + frame / 10,
        frame=frame,
        xy_m=rng.normal(0, 5, (n, 2)),
        covariance_m2=_symmetric(rng, n),
        shared_covariance_m2=_symmetric(rng, n),
        velocity_mps=rng.normal(0, 1, (n, 2)),
        velocity_covariance=_symmetric(rng, n),
        heading_rad=rng.uniform(-np.pi, np.pi, n),
        heading_sigma_rad=np.where(rng.random(n) < 0.5, np.nan, 0.1),
        box_xyxy=box,
        keypoint_uv=uv,
        keypoint_score=score,
        score=np.where(observed, rng.random(n), np.nan),
        observed=observed,
        existence_probability=rng.random(n),
        z_m=rng.choice([0.0, 0.6], n),
        z_sigma_m=rng.random(n),
        size_m=np.where(person[:, None], [np.nan, np.nan, 1.7], rng.uniform(1, 5, (n, 3))),
        size_sigma_m=rng.random((n, 3)),
    )


def _symmetric(rng, n):
    half = rng.normal(0, 0.1, (n, 2, 2))
    return half + half.transpose(0, 2, 1)


def drawn(n: int, keypoints: int, numbers, integers, flags) -> Tracks:
    """Tracks of whatever values were drawn, in the form that a scene gives back."""
    floats = iter(np.split(numbers, np.cumsum(_widths(keypoints))[:-1], axis=1))
    values = {}
    for name, shape in _shapes(keypoints).items():
        values[name] = next(floats).reshape(n, *shape)
    for name in ("covariance_m2", "shared_covariance_m2", "velocity_covariance"):
        values[name][:, 1, 0] = values[name][:, 0, 1]
    for name in ("keypoint_uv", "keypoint_score"):
        values[name] = values[name].astype(np.float32).astype(float)
    nothing = np.isnan(values["keypoint_uv"]).all(axis=(1, 2))
    values["keypoint_score"][nothing] = 0.0
    values["time_s"] = np.nan_to_num(values["time_s"])
    return Tracks(
        track=np.abs(integers[:, 0]),
        frame=integers[:, 1],
        class_name=np.array(CLASSES)[np.abs(integers[:, 2]) % len(CLASSES)],
        observed=flags,
        **values,
    )


def _shapes(k):
    return {
        "time_s": (),
        "xy_m": (2,),
        "covariance_m2": (2, 2),
        "shared_covariance_m2": (2, 2),
        "velocity_mps": (2,),
        "velocity_covariance": (2, 2),
        "heading_rad": (),
        "heading_sigma_rad": (),
        "box_xyxy": (4,),
        "keypoint_uv": (k, 2),
        "keypoint_score": (k,),
        "score": (),
        "existence_probability": (),
        "z_m": (),
        "z_sigma_m": (),
        "size_m": (3,),
        "size_sigma_m": (3,),
    }


def _widths(k):
    return [int(np.prod(shape)) for shape in _shapes(k).values()]


def width(k: int) -> int:
    """How many numbers a row of :func:`drawn` takes."""
    return sum(_widths(k))


def writer(folder, *, run="r", camera="c", start_utc=NOON, camera_json=CAMERA, rows_per_part=40):
    out = SceneWriter(
        folder,
        camera=camera,
        run=run,
        start_utc=start_utc,
        camera_json=camera_json,
        provenance={"weights": {"yolox": "326524"}},
    )
    out._rows_per_part = rows_per_part
    return out


def store(folder, tracks, **options):
    with writer(folder, **options) as out:
        out.write(tracks)
    return folder


def in_order(tracks: Tracks) -> Tracks:
    return tracks.select(np.lexsort((tracks.time_s, tracks.track)))


def assert_same(found: Tracks, expected: Tracks) -> None:
    for f in fields(Tracks):
        a, b = getattr(found, f.name), getattr(expected, f.name)
        assert a.dtype.kind == b.dtype.kind, f.name
        np.testing.assert_array_equal(a, b, err_msg=f.name, strict=False)
        if a.dtype.kind == "f":
            known = ~np.isnan(a)  # -0.0 is another number than 0.0, bit by bit
            np.testing.assert_array_equal(np.signbit(a[known]), np.signbit(b[known]), f.name)
