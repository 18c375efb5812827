"""MEVA: cameras, annotated boxes as tracks on the ground, and labelled activities.

The published cameras stand in the frame of a whole site, whose terrain rises and falls by a metre
and more, and slopes. So the ground in front of a camera is found from the people, as for any
camera: the published focal length and lens are kept, the published tilt and roll are a prior of a
degree, and the height above the plane on which people stand is free. Nothing is chosen by hand,
and no label is looked at.
"""

import re
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.calibration.watching import noted_annotations
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections
from scene4d.core.progress import Advance, Progress
from scene4d.core.tracks import Tracks
from scene4d.formats.activities import LabelledActivity, read_activities
from scene4d.formats.cameras import read_calibration
from scene4d.searching.activities.identity import unite_tracks, united_numbers
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.stages import stage_of
from scene4d.store.log import Look
from scene4d.tracking import TrackOptions
from scene4d.tracking.annotated import looks_of
from scene4d.tracking.following import follow
from scene4d.tracking.placing import known_classes

_FPS = 30.0
_RATE_HZ = TrackOptions.rate_hz
_SLOPE_SIGMA_RAD = np.radians(1.0)
"""How far the local ground may slope against the horizontal. Chosen by hand: a car park drains by
1 to 2 % (0.6 to 1.1 degrees)."""
EVERY = 30
"""Frames between two sightings of a person that are used for the ground: one second."""

_GEOM, _ACTIVITIES, _ARCHIVE = ".geom.yml", ".activities.yml", "annotations.tar.xz"
_NAME = re.compile(
    r"(?P<day>\d{4}-\d\d-\d\d)\.(?P<begin>\d\d-\d\d-\d\d)\.(?P<end>\d\d-\d\d-\d\d)\.\w+\.(?P<camera>\w+)"
)


@dataclass(frozen=True, eq=False)
class Ground:
    """A camera over its local ground; ``reason`` says why it is the published one, if it is."""

    camera: str
    published: Calibration
    calibration: Calibration
    reason: str = ""

    def __str__(self) -> str:
        """Name, tilt and height, beside what was published."""
        was, found = self.published.camera, self.calibration
        assert was is not None
        assert found.camera is not None
        before = f"tilt {np.degrees(was.tilt_rad):.1f}°, height {was.height_m:.1f} m"
        if self.reason:
            return f"{self.camera}: as published, {before} ({self.reason})"
        spread = np.sqrt(np.diag(found.parameter_covariance))
        return (
            f"{self.camera}: tilt {np.degrees(found.camera.tilt_rad):.1f} ± "
            f"{np.degrees(spread[1]):.1f}°, height {found.camera.height_m:.1f} ± "
            f"{found.camera.height_m * spread[3]:.1f} m (published: {before})"
        )


@dataclass(frozen=True, eq=False)
class Clip:
    """One annotated clip: camera, length, tracks, ground, and labelled activities.

    ``united`` has the track in ``stage`` of every annotated track (:func:`.unite_tracks`).
    """

    name: str
    camera: str
    minutes: float
    stage: Stage
    ground: Ground
    labelled: tuple[LabelledActivity, ...]
    united: Mapping[int, int]

    def labels(self, names: Sequence[str]) -> list[LabelledActivity]:
        """What is labelled with one of these names; actors are tracks of the stage."""
        return [
            replace(one, actors=tuple(self.united.get(actor, actor) for actor in one.actors))
            for one in self.labelled
            if one.name in names
        ]

    def label_s(self, names: Sequence[str]) -> Float[np.ndarray, "r 2"]:
        """When anything of these names happens, in seconds."""
        spans = [(one.begin_frame, one.end_frame) for one in self.labels(names)]
        return np.array(spans, float).reshape(-1, 2) / _FPS


Detect = Callable[[Sequence[Look]], Sequence[Look]]
"""What a detector makes of looks at true boxes: boxes without track numbers."""


def meva_clips(
    data: str | Path, cameras: Sequence[str], progress: Progress, detect: Detect | None = None
) -> list[Clip]:
    """The clips of some cameras, in the order of their names.

    With ``detect`` their tracks are not the annotated ones but those that our tracker makes of what
    a simulated detector sees: labels keep their times, their actors are nobody's tracks.
    ``data`` holds ``cameras/*.krtd`` and the annotations, as ``annotations.tar.xz`` or unpacked in
    ``annotations/``. Raises :class:`InputError` for what is missing and what cannot be read.
    """
    folder = Path(data)
    published = {
        camera: read_calibration(folder / "cameras" / f"{camera}.krtd") for camera in cameras
    }
    with _annotations(folder) as unpacked:
        files: dict[str, list[Path]] = {camera: [] for camera in cameras}
        for path in sorted(unpacked.rglob(f"*{_GEOM}")):
            if (name := _NAME.match(path.name)) and name["camera"] in files:
                files[name["camera"]].append(path)
        missing = sorted(camera for camera, paths in files.items() if not paths)
        if missing:
            raise InputError(f"{folder}: holds no annotated clip of camera {', '.join(missing)}")
        total = 2 * sum(map(len, files.values()))
        with progress.stage("Following annotated people and vehicles", total) as step:
            clips = [
                clip
                for camera in cameras
                for clip in _clips(camera, published[camera], files[camera], step, detect)
            ]
    return sorted(clips, key=lambda clip: clip.name)


@contextmanager
def _annotations(folder: Path) -> Iterator[Path]:
    if (folder / "annotations").is_dir():
        yield folder / "annotations"
        return
    archive = folder / _ARCHIVE
    with tempfile.TemporaryDirectory(prefix="scene4d-") as scratch:
        try:
            with tarfile.open(archive) as packed:
                packed.extractall(scratch, filter="data")
        except (OSError, tarfile.TarError, EOFError) as error:
            raise InputError(
                f"{archive}: cannot be unpacked: {error}; expected the annotations of MEVA there, "
                f"or unpacked in {folder / 'annotations'}"
            ) from error
        yield Path(scratch)


def _clips(
    camera: str,
    published: Calibration,
    files: Sequence[Path],
    step: Advance,
    detect: Detect | None,
) -> Iterator[Clip]:
    """The clips of one camera; ``step`` is called for each file read and each clip made."""
    annotated = []
    for path in files:
        found, _ = noted_annotations(path, published.image_size, _FPS, drop_invalid=True)
        annotated.append(found)
        step(1)
    ground = local_ground(camera, published, annotated)
    for path, found in zip(files, annotated, strict=True):
        clip = _clip(path, found, ground)
        yield clip if detect is None else _detected(clip, found, detect)
        step(1)


def _clip(path: Path, annotated: Detections, ground: Ground) -> Clip:
    name = _NAME.match(path.name)
    assert name is not None
    begin, end = (datetime.strptime(name[key], "%H-%M-%S") for key in ("begin", "end"))
    stem = path.name.removesuffix(_GEOM)
    stage = stage_of(_followed(annotated, ground), ground.calibration, everybody=False)
    before, united = stage.tracks.track[stage.first_row], united_numbers(stage)
    return Clip(
        name=stem,
        camera=ground.camera,
        minutes=(end - begin) % timedelta(days=1) / timedelta(minutes=1),
        stage=unite_tracks(stage, united),
        ground=ground,
        labelled=read_activities(path.with_name(stem + _ACTIVITIES)),
        united=dict(zip(before.tolist(), united.tolist(), strict=True)),
    )


def _detected(clip: Clip, annotated: Detections, detect: Detect) -> Clip:
    """The clip with the tracks of what a detector sees of its objects, one box each."""
    number = np.array([clip.united.get(track, track) for track in annotated.track.tolist()], int)
    _, first = np.unique(np.column_stack([annotated.frame, number]), axis=0, return_index=True)
    true = replace(annotated, track=number).select(first)
    tracks = _followed(true, clip.ground, detect)
    return replace(clip, stage=stage_of(tracks, clip.ground.calibration))


def _followed(annotated: Detections, ground: Ground, detect: Detect | None = None) -> Tracks:
    """What ``scene4d track --annotations`` writes into a scene, or ``scene4d track`` with a
    detector, ordered by (track, time).
    """
    found, _ = known_classes(annotated)
    looks = [*looks_of(found.select(np.lexsort([found.track, found.frame])), _RATE_HZ, _FPS)]
    seen = looks if detect is None else detect(looks)
    height_m, trusted = ground.calibration.person_height_m, detect is None
    tracks = Tracks.concatenate([*follow(seen, ground.calibration, height_m, trusted=trusted)])
    return tracks.select(np.lexsort([tracks.time_s, tracks.track]))


def local_ground(name: str, published: Calibration, annotated: Sequence[Detections]) -> Ground:
    """The published camera over the plane on which the people of its clips (one or more) stand."""
    from scene4d.calibration import CalibrateOptions, person_segments, solve_segments

    camera = published.camera
    assert camera is not None
    orientation = Orientation(
        focal_px=float(camera.K[0, 0]),
        tilt_rad=camera.tilt_rad,
        roll_rad=camera.roll_rad,
        tilt_sigma_rad=float(_SLOPE_SIGMA_RAD),
        roll_sigma_rad=float(_SLOPE_SIGMA_RAD),
    )
    options = CalibrateOptions(lens=camera.lens, orientation=orientation)
    found = solve_segments(person_segments(_thinned(annotated)), published.image_size, options)
    if found.reason is not None:
        return Ground(name, published, published, found.reason)
    return Ground(name, published, found)


def _thinned(annotated: Sequence[Detections]) -> Detections:
    """One sighting per second of everything, with track numbers of its own in every clip."""
    parts, number = [], 0
    for one in annotated:
        some = one.select(one.frame % EVERY == 0)
        parts.append(replace(some, track=some.track + number))
        number += int(one.track.max(initial=0)) + 1
    return Detections.concatenate(parts)
