"""The footage of events: where it is, and clips cut out of it around those who take part."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.searching.pages._clip import Clip, Crop, crop_region, cut_out
from scene4d.searching.pages._rings import Rings
from scene4d.searching.result import FoundEvent, SearchResult
from scene4d.store.footage import NoFootage, footage_of

if TYPE_CHECKING:
    from scene4d.video.frames import Source

_CLIP_HZ = 10.0
"""Pictures per second of a clip: enough to see who does what, a third of the bytes of video."""
_MOST_PICTURES = 100
"""Longer events are shown faster than they were: ten seconds of clip are watched to the end."""
_LEAD_S = 1.0
"""A clip begins this long before its event, and ends as long after it."""


def clips_of(result: SearchResult) -> list[Clip | NoFootage]:
    """For each event that is shown a clip, or why there is none; videos are read once each."""
    clips: dict[int, Clip | NoFootage] = {}
    by_run: dict[str, list[int]] = {}
    for number, found in enumerate(result.shown):
        by_run.setdefault(found.run.run, []).append(number)
    footage = result.asked.options.footage
    given = None if footage is None else Path(footage)
    for numbers in by_run.values():
        events = [result.shown[number] for number in numbers]
        run = events[0].run
        place = footage_of(run, given, alone=len(result.runs) == 1)
        if isinstance(place, NoFootage):
            clips |= dict.fromkeys(numbers, place)
        else:
            known = Calibration.load(result.asked.scene.camera_file(run.camera))
            rings = [
                Rings(found, result.asked.query.activity.option(found.event.activity), known)
                for found in events
            ]
            made = _cut(place, events, rings, known.image_size)
            clips |= zip(numbers, made, strict=True)
    return [clips[number] for number in range(len(result.shown))]


def _cut(
    place: Path,
    events: Sequence[FoundEvent],
    rings: Sequence[Rings],
    image_size: tuple[int, int],
) -> list[Clip | NoFootage]:
    """The clips of one video's events, in one go through it."""
    from scene4d.video.reader import open_source

    with ExitStack() as opened:
        try:
            source = opened.enter_context(open_source(place))
            if source.image_size != image_size:
                (w, h), (cw, ch) = source.image_size, image_size
                raise InputError(f"{place.name} is {w}x{h}, but the camera was {cw}x{ch}")
            return _clips(source, events, rings)
        except InputError as error:
            return [NoFootage(f"The footage cannot be shown: {error}.")] * len(events)


def _clips(
    source: "Source", events: Sequence[FoundEvent], rings: Sequence[Rings]
) -> list[Clip | NoFootage]:
    fps = source.fps or _CLIP_HZ
    wanted = [_frames(found, fps, source.frame_count or 0) for found in events]
    regions = [crop_region(found.around, found.event, source.image_size) for found in events]
    crops: list[list[Crop]] = [[] for _ in events]
    every = np.unique(np.concatenate(wanted))
    for frame in source.frames(every.tolist()) if len(every) else ():
        for number, found in enumerate(events):
            region = regions[number]
            if region is not None and frame.index in wanted[number]:
                boxes, near = _boxes(found, frame.index), rings[number].at(frame.index)
                picture = cut_out(frame.image_bgr, region, boxes, near)
                crops[number].append(Crop((frame.index - found.begin_frame) / fps, picture))
    return [_clip(part, frames, fps) for part, frames in zip(crops, wanted, strict=True)]


def _frames(found: FoundEvent, fps: float, count: int) -> Int[np.ndarray, "k"]:
    """The pictures of a clip: evenly, and at most :data:`_MOST_PICTURES`."""
    lead = round(_LEAD_S * fps)
    first, last = max(0, found.begin_frame - lead), min(count - 1, found.end_frame + lead)
    step = max(1, round(fps / _CLIP_HZ), -(-(last - first + 1) // _MOST_PICTURES))
    return np.arange(first, last + 1, step)


def _clip(crops: list[Crop], frames: Int[np.ndarray, "k"], fps: float) -> Clip | NoFootage:
    if not crops:
        return NoFootage("The footage does not hold the frames of this event.")
    step = int(frames[1] - frames[0]) if len(frames) > 1 else 1
    rate = min(fps, _CLIP_HZ)
    return Clip(tuple(crops), rate, round(step / fps * rate, 1))


def _boxes(found: FoundEvent, frame: int) -> dict[str, Float[np.ndarray, "4"] | None]:
    """Where each role is at a frame, interpolated between the rows that were searched."""
    assert found.around is not None
    boxes: dict[str, Float[np.ndarray, 4] | None] = {}
    for role, number in found.event.roles.items():
        rows = found.around.select(found.around.track == number)
        rows = rows.select(np.isfinite(rows.box_xyxy[:, 0]))
        here = len(rows) and rows.frame[0] <= frame <= rows.frame[-1]
        sides = [np.interp(frame, rows.frame, side) for side in rows.box_xyxy.T] if here else None
        boxes[role] = None if sides is None else np.array(sides)
    return boxes
