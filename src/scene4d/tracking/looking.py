"""Where looks come from: the log of what detectors saw, or a file of annotations."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scene4d.calibration.watching import noted_annotations
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.store.schema import RUN_TRACKS
from scene4d.tracking.following import Look
from scene4d.tracking.options import TrackOptions, TrackRun
from scene4d.tracking.placing import known_classes

if TYPE_CHECKING:
    from scene4d.store.log import DetectionLog

_FRAMES_PER_LOOK = 300
"""Annotated frames that are placed and followed at once."""


def looks_of_log(log: "DetectionLog") -> Iterator[Look]:
    """What the detectors saw, chunk by chunk."""
    for chunk in log.chunks():
        yield Look(chunk.frame, chunk.time_s, chunk.detections, chunk.appearance)


def looks_of_annotations(
    path: Path,
    image_size: tuple[int, int],
    fps: float | None,
    options: TrackOptions,
    run: TrackRun,
    frame_count: int | None = None,
) -> Iterator[Look]:
    """The annotated frames at the rate asked for, read at once and given out piece by piece.

    In each slot of the rate the first annotated frame is taken; a slot without any was looked at,
    and nobody was there. ``frame_count`` is that of the footage, where it is known. Raises
    :class:`InputError` where the frame rate is not known, a frame is not in the footage or a track
    is twice in a frame, and as :func:`.read_annotations`.
    """
    if fps is None:
        raise InputError(f"{path}: frames need times: give the footage, or --fps")
    found, notes = noted_annotations(
        path, image_size, fps, format=options.format, drop_invalid=options.drop_invalid
    )
    run.warnings.extend(notes)
    found, others = known_classes(found)
    if others:
        run.warnings.append(f"{path}: {others} boxes of other classes were left out.")
    if not len(found):
        run.warnings.append(f"{path}: holds no person and no vehicle.")
        return iter(())
    last = int(found.frame.max())
    if frame_count is not None and last >= frame_count:
        raise InputError(
            f"{path}: annotates frame {last} (from 0), but the footage has {frame_count} frames: "
            "is it the annotation of this footage?"
        )
    found = _one_kind_of_tracks(found, path, run)
    frames = _slots(found.frame, fps, options.rate_hz)
    found = found.select(np.isin(found.frame, frames))
    return _pieces(found.select(np.argsort(found.frame, kind="stable")), frames, fps)


def _one_kind_of_tracks(found: Detections, path: Path, run: TrackRun) -> Detections:
    """Tracks for all boxes or for none; raises where a track is in a frame twice."""
    if (found.track < 0).any():
        if (found.track >= 0).any():
            run.warnings.append(f"{path}: some boxes have no track, so all are tracked anew.")
        return replace(found, track=np.full(len(found), -1))
    pairs, counts = np.unique(
        np.column_stack([found.frame, found.track]), axis=0, return_counts=True
    )
    if (counts > 1).any():
        frame, track = pairs[int(np.argmax(counts > 1))].tolist()
        raise InputError(
            f"{path}: track {track} has {counts.max()} boxes in frame {frame} (from 0); a track is "
            "one object: give each its own number, or -1 to all"
        )
    if found.track.max() >= RUN_TRACKS:
        raise InputError(
            f"{path}: track {found.track.max()} is too large a number; expected up to "
            f"{RUN_TRACKS - 1}"
        )
    return found


def _slots(annotated: np.ndarray, fps: float, rate_hz: float) -> np.ndarray:
    """Frames to look at: in each 1/rate of a second the first annotated one, else the first."""
    everything = np.arange(int(annotated.min()), int(annotated.max()) + 1)
    slot = np.floor(everything / fps * rate_hz + 1e-6)
    order = np.lexsort([everything, ~np.isin(everything, annotated), slot])
    first = np.diff(slot[order], prepend=slot[0] - 1) > 0
    return np.asarray(everything[order][first])


def _pieces(found: Detections, frames: np.ndarray, fps: float) -> Iterator[Look]:
    for begin in range(0, len(frames), _FRAMES_PER_LOOK):
        some = frames[begin : begin + _FRAMES_PER_LOOK]
        rows = np.arange(*np.searchsorted(found.frame, [some[0], some[-1] + 1]))
        yield Look(some, some / fps, found.select(rows))
