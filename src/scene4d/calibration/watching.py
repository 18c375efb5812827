"""One pass over the footage: people, camera motion, the scene's edges, orientation."""

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.calibration._guess import solve_guided
from scene4d.calibration._segments import missing_keypoints, person_segments
from scene4d.calibration._upright import turned_footage
from scene4d.calibration._watching_vehicles import annotated_vehicles, watch_vehicles
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.orienting import MOST_FRAMES, OrientationReader, OrientationReading
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Progress, timed

if TYPE_CHECKING:
    from scene4d.perception.people import PeopleDetector
    from scene4d.video.frames import Frame, Source
    from scene4d.video.motion import MotionVerdict

_ROUGH_FRAMES = 12
"""Frames for a rough camera, which tells the detector how large people are in each row."""
_NETWORK_FRAMES = 32
"""Frames for the orientation network if its estimate is only a guess: the errors of frames are
nearly the same. If its estimate is used as is: all frames, up to :data:`.MOST_FRAMES`."""


@dataclass
class Seen:
    """What the footage shows; ``reading`` is None if the orientation network was not used, and
    ``vehicles`` (tracked) where vehicles were not looked for.
    """

    detections: Detections
    frames: int
    edges_xyxy: np.ndarray | None = None
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    reading: OrientationReading | None = None
    notes: list[str] = field(default_factory=list)
    vehicles: Detections | None = None


def solved(seen: Seen, options: CalibrateOptions) -> Calibration:
    """The calibration from what was seen; notes made while watching are among its warnings.

    The paper's method takes the boxes, as published; the joint one takes keypoints where there are
    some. The files that ``options`` name must have been read (:meth:`CalibrateOptions.read`).
    """
    joint = options.method == "joint"
    people = seen.detections if joint else seen.detections.without_keypoints()
    found = solve_guided(
        person_segments(people),
        people.image_size,
        options,
        seen.reading,
        edges_xyxy=seen.edges_xyxy,
        vehicles=seen.vehicles,
        alone=None if joint else _without_network(seen, options),
        image_bgr=seen.image_bgr,
    )
    said = [*seen.notes]
    missing = missing_keypoints(people)
    if missing:
        said.append(
            f"The annotations' keypoints lack {', '.join(missing)}; their boxes were used instead."
        )
    return replace(found, frames=seen.frames, warnings=(*said, *found.warnings))


def _without_network(seen: Seen, options: CalibrateOptions) -> Calibration | None:
    """The joint answer from everything but the network's reading; None where none was made."""
    if seen.reading is None or not options.uses_network:
        return None
    return solved(
        replace(seen, reading=None), replace(options, method="joint", orientation="people")
    )


def fetch_weights(progress: Progress, *, vehicles: bool = False) -> None:
    """Download missing networks, those for vehicles only if ``vehicles``.

    Raises as :func:`perception.weights.fetch_all`.
    """
    from scene4d.perception.weights import PEOPLE_WEIGHTS, fetch_all, missing_weights

    names = None if vehicles else PEOPLE_WEIGHTS
    if not missing_weights(names=names):
        fetch_all(names=names)  # checks those that are here
        return
    percent = 0

    def told(source: str, so_far: int, total: int) -> None:
        nonlocal percent
        now = 100 * so_far // total if total else percent
        step(now - percent)
        percent = now

    with progress.stage("Fetching the networks", 100) as step:
        fetch_all(told, names=names)


def annotated(options: CalibrateOptions, image_size: tuple[int, int], fps: float | None) -> Seen:
    """People from an annotation file instead of a detector."""
    assert options.annotations is not None
    detections, notes = noted_annotations(
        options.annotations,
        image_size,
        fps,
        format=options.format,
        drop_invalid=options.drop_invalid,
    )
    seen = Seen(detections, len(np.unique(detections.frame)), notes=notes)
    if needs_vehicles(seen, options):
        seen.vehicles = annotated_vehicles(detections)
    return seen


def noted_annotations(
    path: str | Path, image_size: tuple[int, int], fps: float | None, **reading: Any
) -> tuple[Detections, list[str]]:
    """The boxes of a file, and its reader's warnings as sentences.

    ``reading`` are further parameters of :func:`.read_annotations`.
    """
    from scene4d.formats.annotations import read_annotations

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        found = read_annotations(path, image_size=image_size, fps=fps, **reading)
    return found, [f"{str(w.message).rstrip('.?')}." for w in caught]


def watch(
    footage: "Source", options: CalibrateOptions, progress: Progress, timings: dict[str, float]
) -> Seen:
    """Process sampled frames once: people, camera motion, the scene's edges, and the orientation
    network's estimate.

    The files that ``options`` name must have been read (:meth:`CalibrateOptions.read`).
    """
    from scene4d.perception.lines import straight_edges
    from scene4d.video.background import Background
    from scene4d.video.motion import MotionMonitor
    from scene4d.video.sampling import expected_count, sample_frames

    people = None if options.annotations else _people_detector(footage, options, progress)
    monitor = MotionMonitor(footage.image_size)
    expected = expected_count(footage, options.frames)
    background = Background(footage.image_size, expected)
    reader = _reader(footage.image_size, options, expected)
    notes: list[str] = []
    parts: list[Detections] = []
    busiest: tuple[int, np.ndarray | None] = (0, None)
    sampled: list[int] = []
    elsewhere: list[int] = []
    with timed(timings, "decode and detect"), progress.stage("Watching people", expected) as step:
        for frame in sample_frames(footage, options.frames):
            sampled.append(frame.index)
            step(1)
            if not monitor.add(frame.image_bgr, frame.time_s):
                elsewhere.append(frame.index)
                continue
            background.add(frame)
            if reader is not None and not _offered(reader, frame, options, notes):
                reader = None
            if people is not None:
                parts.append(people.look(frame))
                if len(parts[-1]) > busiest[0]:
                    busiest = len(parts[-1]), frame.image_bgr.copy()
    if not sampled:
        raise InputError(f"{footage.name}: no frame could be read")
    verdict = monitor.verdict()
    if verdict.moved:
        raise InputError(f"{footage.name}: {verdict.reason}")
    if people is None:
        seen = annotated(options, footage.image_size, footage.fps)
        of_view = ~_nearest_in(seen.detections.frame, sampled, elsewhere)
        seen.detections = seen.detections.select(of_view)
        if seen.vehicles is not None:
            elsewhere_too = _nearest_in(seen.vehicles.frame, sampled, elsewhere)
            seen.vehicles = seen.vehicles.select(~elsewhere_too)
    else:
        seen = Seen(Detections.concatenate(parts), len(sampled) - len(elsewhere))
        drop_stationary(seen)
        _drop_unlike(seen)
        whole = len(person_segments(seen.detections))
        turned = turned_footage(people, background.kept_bgr, whole, seen.frames)
        if turned is not None:
            raise InputError(f"{footage.name}: {turned}")
    seen.notes.extend(notes)
    if verdict.frames_moved:
        seen.notes.append(_left_out(verdict))
    seen.reading = None if reader is None else reader.reading()
    if verdict.reason is not None and len(sampled) > 1:
        seen.notes.append(f"{verdict.reason[0].upper()}{verdict.reason[1:]}.")
    seen.image_bgr, seen.people_bgr = background.image(), busiest[1]
    if options.lines and options.method == "joint" and seen.image_bgr is not None:
        with timed(timings, "edges"):
            hidden = None if background.is_median else seen.detections.box_xyxy
            seen.edges_xyxy = straight_edges(seen.image_bgr, hidden)
    if people is not None and needs_vehicles(seen, options):
        fetch_weights(progress, vehicles=True)
        found = watch_vehicles(footage, progress, timings, options.device)
        if found is not None:
            found = found.select(~_nearest_in(found.frame, sampled, elsewhere))
        seen.vehicles = found
    return seen


def needs_vehicles(seen: Seen, options: CalibrateOptions) -> bool:
    """Whether vehicles are asked for, or help: where nothing else determines the camera."""
    if options.method != "joint" or options.vehicles == "never":
        return False
    return options.vehicles == "always" or not solved(seen, options)


def _nearest_in(frame: np.ndarray, sampled: list[int], chosen: list[int]) -> np.ndarray:
    """Of each frame (n,) whether the ``sampled`` one that is nearest to it is ``chosen``."""
    known = np.array(sampled)
    between = (known[1:] + known[:-1]) / 2
    nearest = known[np.searchsorted(between, frame)]
    return np.isin(nearest, chosen)


def _left_out(verdict: "MotionVerdict") -> str:
    at = "" if verdict.moved_at_s is None else f", the first at {verdict.moved_at_s:.1f} s,"
    return (
        f"{verdict.frames_moved} of {verdict.frames_checked} frames{at} show another view and were "
        "left out; the camera is that of the other frames."
    )


def _reader(
    image_size: tuple[int, int], options: CalibrateOptions, expected: int
) -> OrientationReader | None:
    if not options.uses_network:
        return None
    most = MOST_FRAMES if options.needs_network else _NETWORK_FRAMES
    step = max(1, -(-expected // most))
    return OrientationReader(
        image_size, options.known_lens, focal_known=not options.estimate_focal, step=step
    )


def _offered(
    reader: OrientationReader, frame: "Frame", options: CalibrateOptions, notes: list[str]
) -> bool:
    """Show the network a frame; false, with a note, if it fails and is not needed."""
    try:
        reader.offer(frame)
    except InputError as error:
        if options.needs_network:
            raise
        notes.append(f"Only the people were used: {error}.")
        return False
    return True


def drop_stationary(seen: Seen) -> None:
    """Remove sightings that never move, and note how many."""
    from scene4d.perception.stationary import stationary

    still = stationary(seen.detections)
    if still.any():
        seen.detections = seen.detections.select(~still)
        seen.notes.append(
            f"{int(still.sum())} sightings that never move (mannequins, posters, reflections) "
            "were left out."
        )


def _drop_unlike(seen: Seen) -> None:
    """Remove what passes for people and has no body; note how many seemed to be seen whole."""
    from scene4d.perception.likeness import unlike_people

    whole = len(person_segments(seen.detections))
    seen.detections = seen.detections.select(~unlike_people(seen.detections))
    fewer = whole - len(person_segments(seen.detections))
    if fewer:
        seen.notes.append(
            f"Sightings that look more like things than like people were left out: {fewer}."
        )


def _people_detector(
    footage: "Source", options: CalibrateOptions, progress: Progress
) -> "PeopleDetector":
    """The default detector; if it needs tiles, a rough camera first shows it where."""
    from scene4d.perception.detectors.tiles import choose_tiles
    from scene4d.perception.detectors.yolox import YoloxDetector
    from scene4d.perception.people import PeopleDetector, detect_people
    from scene4d.video.sampling import expected_count, sample_frames

    fetch_weights(progress)
    people = PeopleDetector.default(options.device)
    many = expected_count(footage, options.frames)
    if footage.timeline is None or many < 3 * _ROUGH_FRAMES:
        return people
    if len(choose_tiles(footage.image_size)) == 0:
        return people
    with progress.stage("A first look", _ROUGH_FRAMES) as step:
        rough = detect_people(
            sample_frames(footage, _ROUGH_FRAMES),
            replace(people, tracker=None),
            progress=lambda done, found: step(1),
        )
    people_only = replace(options, method="joint", orientation="people")
    first = solved(Seen(rough, _ROUGH_FRAMES), people_only)
    if not first or first.camera is None:
        return people
    assert isinstance(people.detector, YoloxDetector)
    camera, height_m = first.camera, options.person_height_m
    expecting = people.detector.expecting(lambda rows: person_px(camera, rows, height_m))
    return replace(people, detector=expecting)


def person_px(camera: Camera, rows: np.ndarray, person_height_m: float) -> np.ndarray:
    """Height in pixels of a person with feet at image ``rows``, mid-width; NaN off the ground."""
    middle = np.full(len(rows), (camera.image_size[0] - 1) / 2)
    xy, valid = camera.locate(np.column_stack([middle, rows]))
    head, seen = camera.project(np.column_stack([xy, np.full(len(xy), person_height_m)]))
    height = np.asarray(rows, float) - head[:, 1]
    return np.where(valid & seen & (height > 0), height, np.nan)
