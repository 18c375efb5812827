"""The footage of events: where it is, and pictures cut out of it around those who take part."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.searching.finding import FoundEvent
from scene4d.searching.pages.clip import Clip, Crop, crop_region, cut_out
from scene4d.store.runs import Run

if TYPE_CHECKING:
    from scene4d.video.frames import Source

_CLIP_HZ = 10.0
"""Pictures per second of a clip."""
_MOST_PICTURES = 100
"""Longer events are shown faster than they were."""
_LEAD_S = 1.0
"""So much before and after an event is in its clip."""
_ANNOTATIONS = (".geom.yml", ".types.yml", ".yml", ".yaml", ".xml", ".txt", ".json", ".csv")


@dataclass(frozen=True)
class NoFootage:
    """Why there are no pictures, in words for the page."""

    reason: str


def clips_of(
    events: Sequence[FoundEvent],
    image_sizes: Mapping[str, tuple[int, int]],
    given: Path | None,
    *,
    alone: bool = False,
) -> Iterator[tuple[int, "Clip | NoFootage"]]:
    """For each event, by its position, a clip or why there is none; run by run.

    ``given`` is a file or a folder in which to look, instead of where the footage was when it was
    tracked, ``alone`` says that only one run was searched; ``image_sizes`` are those of the
    cameras. Raises :class:`InputError` where ``given`` is
    not there.
    """
    if given is not None and not given.exists():
        raise InputError(f"{given}: there is no such footage")
    by_run: dict[str, list[int]] = {}
    for number, one in enumerate(events):
        by_run.setdefault(one.run.run, []).append(number)
    for numbers in by_run.values():
        run = events[numbers[0]].run
        place = footage_of(run, given, alone=alone)
        if isinstance(place, Path):
            found = _cut(place, [events[i] for i in numbers], image_sizes[run.camera])
            yield from zip(numbers, found, strict=True)
        else:
            yield from ((number, place) for number in numbers)


def footage_of(run: Run, given: Path | None, *, alone: bool) -> Path | NoFootage:
    """The video that a run was made of, or of which its annotations were.

    A folder is looked through for a file of the same name, and of annotations for one whose name
    begins like theirs. A file is taken if its name fits, or if no other run was searched.
    """
    source = run.provenance.get("source") or run.provenance.get("annotations")
    if alone and given is not None and given.is_file():
        return given
    if not isinstance(source, str):
        return NoFootage("The scene does not say what footage it was made of.")
    annotated = "annotations" in run.provenance
    name = PurePath(source).name
    if given is None:
        if annotated:
            return NoFootage(f"It was tracked in the annotations {name}, without footage.")
        if "://" in source:
            return NoFootage("It was tracked in a stream, which is gone.")
        path = Path(source)
        return path if path.exists() else NoFootage(f"The footage is no longer at {source}.")
    stem = _stem(name)
    if given.is_file():
        if given.name == name or given.stem.startswith(stem):
            return given
        return NoFootage(f"{given.name} is not the footage of this clip, {name}.")
    there = sorted(given.iterdir())
    same = [path for path in there if path.name == name and not annotated]
    like = [path for path in there if path.name.startswith(stem) and not _is_annotation(path)]
    if not (same or like):
        return NoFootage(f"{given} holds no footage named like {name}.")
    return (same or like)[0]


def _stem(name: str) -> str:
    ending = next((end for end in _ANNOTATIONS if name.endswith(end)), PurePath(name).suffix)
    return name.removesuffix(ending)


def _is_annotation(path: Path) -> bool:
    return path.name.endswith(_ANNOTATIONS)


def _cut(
    place: Path, events: Sequence[FoundEvent], image_size: tuple[int, int]
) -> list[Clip | NoFootage]:
    """The clips of one video's events, in one go through it."""
    from scene4d.video.reader import open_source

    with ExitStack() as opened:
        try:
            source = opened.enter_context(open_source(place))
            if source.image_size != image_size:
                (w, h), (cw, ch) = source.image_size, image_size
                raise InputError(f"{place.name} is {w}x{h}, but the camera was {cw}x{ch}")
            return [*_clips(source, events)]
        except InputError as error:
            return [NoFootage(f"The footage cannot be shown: {error}.")] * len(events)


def _clips(source: "Source", events: Sequence[FoundEvent]) -> list[Clip | NoFootage]:
    fps = source.fps or _CLIP_HZ
    count = source.frame_count or 0
    wanted = [_frames(one, fps, count) for one in events]
    regions = [crop_region(one.around, one.event, source.image_size) for one in events]
    crops: list[list[Crop]] = [[] for _ in events]
    every = np.unique(np.concatenate(wanted)) if wanted else np.zeros(0, np.int64)
    if len(every):
        for frame in source.frames(every.tolist()):
            for number, one in enumerate(events):
                region = regions[number]
                if region is None or frame.index not in wanted[number]:
                    continue
                picture = cut_out(frame.image_bgr, region, _boxes(one, frame.index))
                crops[number].append(Crop((frame.index - one.begin_frame) / fps, picture))
    return [_clip(part, frames, fps) for part, frames in zip(crops, wanted, strict=True)]


def _frames(found: FoundEvent, fps: float, count: int) -> Int[np.ndarray, "k"]:
    """The pictures of a clip: evenly, and at most :data:`_MOST_PICTURES`."""
    lead = round(_LEAD_S * fps)
    first, last = max(0, found.begin_frame - lead), min(count - 1, found.end_frame + lead)
    if last < first:
        return np.zeros(0, np.int64)
    step = max(1, round(fps / _CLIP_HZ), -(-(last - first + 1) // _MOST_PICTURES))
    return np.arange(first, last + 1, step)


def _clip(crops: list[Crop], frames: Int[np.ndarray, "k"], fps: float) -> Clip | NoFootage:
    if not crops:
        return NoFootage("The footage does not hold the frames of this event.")
    step = int(frames[1] - frames[0]) if len(frames) > 1 else 1
    rate = min(fps, _CLIP_HZ)
    return Clip(tuple(crops), rate, round(step / fps * rate, 1))


def _boxes(found: FoundEvent, frame: int) -> dict[str, Float[np.ndarray, "4"] | None]:
    """Where each role is at a frame, between the rows that were searched."""
    tracks = found.around
    boxes: dict[str, Float[np.ndarray, 4] | None] = {}
    for role, number in found.event.roles.items():
        boxes[role] = None
        if tracks is None:
            continue
        rows = np.flatnonzero((tracks.track == number) & np.isfinite(tracks.box_xyxy[:, 0]))
        if len(rows) and tracks.frame[rows[0]] <= frame <= tracks.frame[rows[-1]]:
            known = tracks.frame[rows]
            boxes[role] = np.array(
                [np.interp(frame, known, side) for side in tracks.box_xyxy[rows].T]
            )
    return boxes
