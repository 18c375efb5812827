"""Where looks come from: the log of what detectors saw, or a file of annotations."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scene4d.errors import InputError
from scene4d.pipeline.tracking.following import Look
from scene4d.pipeline.tracking.options import TrackOptions, TrackRun
from scene4d.pipeline.tracking.placing import known_classes

if TYPE_CHECKING:
    from scene4d.scene.log import DetectionLog

FRAMES_PER_LOOK = 300
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
) -> Iterator[Look]:
    """The annotated frames at the rate asked for. Frames between the first and the last without
    any box were looked at, and nobody was there.

    Raises :class:`InputError` where the frame rate is not known, and as
    :func:`.read_annotations`.
    """
    from scene4d.formats.annotations import read_annotations

    if fps is None:
        raise InputError(f"{path}: frames need times: give the footage, or --fps")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        found = read_annotations(
            path, image_size=image_size, fps=fps, drop_invalid=options.drop_invalid
        )
    run.warnings.extend(f"{str(w.message).rstrip('.?')}." for w in caught)
    found, others = known_classes(found)
    if others:
        run.warnings.append(f"{path}: {others} boxes of other classes were left out.")
    if not len(found):
        run.warnings.append(f"{path}: holds no person and no vehicle.")
        return
    everything = np.arange(int(found.frame.min()), int(found.frame.max()) + 1)
    slot = np.floor(everything / fps * options.rate_hz + 1e-6)
    frames = everything[np.diff(slot, prepend=slot[0] - 1) > 0]
    found = found.select(np.isin(found.frame, frames))
    found = found.select(np.argsort(found.frame, kind="stable"))
    for begin in range(0, len(frames), FRAMES_PER_LOOK):
        some = frames[begin : begin + FRAMES_PER_LOOK]
        rows = np.arange(*np.searchsorted(found.frame, [some[0], some[-1] + 1]))
        yield Look(some, some / fps, found.select(rows))
