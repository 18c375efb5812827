"""VIRAT ground data set, release 2.0: the second experiment of Wagner et al. (2019), section 4.

The truth is the scene's homography from pixels to ground metres, with people and vehicles from
the annotation. A clip ``VIRAT_S_XXYYZZ...`` was recorded in scene ``XXYY`` (collection and scene;
introduction to the release, section 2.2). The folder holds the official files, in sub-folders or
not: ``*_XXYY_homography_img2world.txt``, ``CLIP.viratdata.objects.txt`` and perhaps ``CLIP.mp4``.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.core.people import Detections
from scene4d.evaluation.datasets._reference import PUBLISHED, Meetings, Reference
from scene4d.formats.annotations import read_annotations
from scene4d.formats.homographies import read_ground_map
from scene4d.searching.predicates import NEAR_TAU_M
from scene4d.video.frames import VIDEO_SUFFIXES

_OBJECTS = ".viratdata.objects.txt"
_VEHICLES = ("car", "vehicle")
_PLACE_M = 1.0
"""A vehicle counts once per ground square of this side, so a parked one counts once and not once
per frame. Chosen by hand: below a vehicle's width, above the jitter of the annotation."""

_HOMOGRAPHY = re.compile(r"(\d{4})_homography_img2world\.txt$")
_SCENE = re.compile(r"VIRAT_S_(\d{4})")
_NAMED = 8
"""Clips that an error message lists."""
_ROUGH = (
    "The homographies of VIRAT are rough estimates, as their README says: the errors here include "
    "theirs."
)


@dataclass(frozen=True, eq=False)
class ViratScene:
    """One clip: ``name`` is its scene (``0000``), ``people`` the annotated persons of all frames.

    ``video`` is None where it is not in the folder. ``notes`` say how to read the figures.
    """

    name: str
    clip: str
    reference: Reference
    annotations: Path
    video: Path | None
    people: Detections
    notes: tuple[str, ...]


def virat(
    data: str | Path, *, clip: str | None = None, image_size: tuple[int, int] | None = None
) -> ViratScene:
    """A clip of VIRAT by its name (``VIRAT_S_000001``), or the first in order of names.

    ``image_size`` is needed where the video is not in the folder. Impossible boxes are left out
    with a warning. Raises :class:`InputError` where a file is missing or there are two, for files
    that cannot be read, and for a clip without persons.
    """
    folder = Path(data)
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder; expected the one that holds the files of VIRAT")
    files = sorted(f for f in folder.rglob("*") if f.is_file() and not f.name.startswith("."))
    name, annotations, others = _clip(folder, files, clip)
    scene = _scene(annotations)
    homography = _homography(folder, files, scene, name)
    video = _video(files, name)
    size, fps = _footage(video, image_size, annotations)
    truth = read_ground_map(homography, image_size=size)
    boxes = read_annotations(
        annotations, image_size=size, fps=fps, format="virat", drop_invalid=True
    )
    people = boxes.select(boxes.class_name == "person")
    if not len(people):
        raise InputError(f"{annotations}: holds no persons; choose another clip of {others}")
    vehicles = boxes.select(np.isin(boxes.class_name, _VEHICLES))
    reference, note = _reference(f"VIRAT {scene}", truth, people, vehicles)
    return ViratScene(scene, name, reference, annotations, video, people, (_ROUGH, *note))


def spread_frames(detections: Detections, count: int = PUBLISHED["virat"].frames) -> Detections:
    """The detections of at most ``count`` frames, evenly over those that hold any."""
    frames = np.unique(detections.frame)
    if len(frames) <= count:
        return detections
    chosen = frames[np.linspace(0, len(frames) - 1, count).round().astype(int)]
    return detections.select(np.isin(detections.frame, chosen))


def _clip(folder: Path, files: Sequence[Path], wanted: str | None) -> tuple[str, Path, str]:
    """Name and annotation of the clip, and the names of all clips in words."""
    found = [f for f in files if f.name.endswith(_OBJECTS)]
    if not found:
        raise InputError(
            f"{folder}: holds no annotation *{_OBJECTS}, nor does a folder in it; expected the "
            "files of the VIRAT ground data set, release 2.0"
        )
    clips = sorted({f.name.removesuffix(_OBJECTS) for f in found})
    words = ", ".join(clips[:_NAMED])
    if len(clips) > _NAMED:
        words += f" and {len(clips) - _NAMED} more"
    name = clips[0] if wanted is None else wanted.removesuffix(_OBJECTS)
    if name not in clips:
        raise InputError(f"{folder}: holds no clip {name!r}; it has {words}")
    return name, _only([f for f in found if f.name == name + _OBJECTS], f"clip {name}"), words


def _scene(annotations: Path) -> str:
    match = _SCENE.match(annotations.name)
    if match is None:
        raise InputError(
            f"{annotations}: the name does not say which scene this is; expected "
            f"VIRAT_S_ and at least four digits, as in VIRAT_S_000001{_OBJECTS}"
        )
    return match[1]


def _homography(folder: Path, files: Sequence[Path], scene: str, clip: str) -> Path:
    known = {f: match[1] for f in files if (match := _HOMOGRAPHY.search(f.name))}
    found = [f for f, digits in known.items() if digits == scene]
    if not found:
        there = ", ".join(sorted(set(known.values()))) or "none"
        raise InputError(
            f"{folder}: the homography of scene {scene} (clip {clip}) is missing; expected "
            f"VIRAT_{scene}_homography_img2world.txt, found those of scenes: {there}"
        )
    return _only(found, f"scene {scene}")


def _video(files: Sequence[Path], clip: str) -> Path | None:
    found = [f for f in files if f.stem == clip and f.suffix.lower() in VIDEO_SUFFIXES]
    return _only(found, f"the video of clip {clip}") if found else None


def _only(found: Sequence[Path], what: str) -> Path:
    if len(found) > 1:
        names = " and ".join(map(str, found))
        raise InputError(f"{found[1]}: there is more than one file for {what}: {names}; leave one")
    return found[0]


def _footage(
    video: Path | None, given: tuple[int, int] | None, annotations: Path
) -> tuple[tuple[int, int], float | None]:
    """Image size and frame rate."""
    if video is None:
        if given is None:
            raise InputError(
                f"{annotations}: its video is not in the folder, so the image size is not known; "
                "give image_size: most scenes of VIRAT are 1920x1080, some 1280x720"
            )
        return given, None
    from scene4d.video.reader import open_source

    with open_source(video) as source:
        size, fps = source.image_size, source.fps
    if given is not None and given != size:
        raise InputError(
            f"{video}: is {size[0]}x{size[1]}, but image_size says {given[0]}x{given[1]}; leave it "
            "out where the video is there"
        )
    return size, fps


def _reference(
    name: str, truth: GroundMap, people: Detections, vehicles: Detections
) -> tuple[Reference, tuple[str, ...]]:
    """The reference, and what to say about its P(near)."""
    feet = people.box_foot_uv
    standing, parked = _on_ground(truth, people), _on_ground(truth, vehicles)
    if not len(parked):
        return Reference(name, truth, feet), (
            "No vehicle is annotated on the ground: the correspondence points stand in for them.",
        )
    places = _places(truth, parked)
    met = _same_frame(spread_frames(standing.select(np.isin(standing.frame, parked.frame))), parked)
    reference = Reference(name, truth, feet, places, meetings=met)
    near = reference.judged[1] < NEAR_TAU_M
    if near.any() and not near.all():
        return reference, ()
    return Reference(name, truth, feet, places), (
        f"Of {len(near)} pairs of a person and a vehicle in the same frame {int(near.sum())} are "
        "near, and an ROC needs both kinds: P(near) is of all people and all places where a "
        "vehicle was, whatever the time.",
    )


def _same_frame(people: Detections, vehicles: Detections) -> Meetings:
    """Everybody with every vehicle of the same frame."""
    order = np.argsort(vehicles.frame, kind="stable")
    frames = vehicles.frame[order]
    begin, end = (np.searchsorted(frames, people.frame, side=side) for side in ("left", "right"))
    person = np.repeat(np.arange(len(people)), end - begin)
    vehicle = np.concatenate([np.empty(0, int), *map(np.arange, begin, end)])
    rows = np.column_stack([person, order[vehicle]])
    return Meetings(people.box_foot_uv, vehicles.box_foot_uv, rows)


def _on_ground(truth: GroundMap, found: Detections) -> Detections:
    """Those whose lowest point is in the picture and below the horizon."""
    uv = found.box_foot_uv
    return found.select((uv[:, 1] <= truth.image_size[1] - 1) & truth.locate(uv)[1])


def _places(truth: GroundMap, vehicles: Detections) -> Float[np.ndarray, "m 2"]:
    """Bottom centres of vehicles in pixels, one per square of :data:`_PLACE_M`."""
    uv = vehicles.box_foot_uv
    square = np.floor(truth.locate(uv)[0] / _PLACE_M)
    first = np.unique(square, axis=0, return_index=True)[1]
    return uv[np.sort(first)]
