"""Looks from an annotation file, in place of the detectors."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration.watching import noted_annotations
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.store.log import Look
from scene4d.store.schema import LONGEST_S, RUN_TRACKS
from scene4d.tracking._options import Job, TrackRun
from scene4d.tracking._smoothing import SmoothingSettings
from scene4d.tracking.placing import known_classes
from scene4d.video.frames import Source

_FRAMES_PER_LOOK = 300
"""Annotated frames processed at once: bounds memory without changing the result."""

TimesOf = Callable[[Int[np.ndarray, "m"]], Float[np.ndarray, "m"]]
"""Maps frame numbers to seconds from the clip's start."""


def annotated_looks(footage: Source | None, job: Job) -> Iterator[Look]:
    """The annotated frames at the requested rate, read at once and yielded piece by piece.

    Frames have the times of the footage if it has a clock and no frame rate is given. Raises
    :class:`InputError` if no times are known, a frame is not in the footage or a track occurs
    twice in a frame, and as :func:`.read_annotations`.
    """
    options, run = job.options, job.run
    path = Path(str(options.annotations))
    fps = options.fps or (None if footage is None else footage.fps)
    if fps is None:
        raise InputError(f"{path}: frames need times: give the footage, or fps")
    found, notes = noted_annotations(
        path,
        job.camera.image_size,
        fps,
        format=options.format,
        drop_invalid=options.drop_invalid,
    )
    run.warnings.extend(notes)
    found, others = known_classes(found)
    if others:
        run.warnings.append(f"{path}: {others} boxes of other classes were left out.")
    if not len(found):
        run.warnings.append(f"{path}: holds no person and no vehicle.")
        return iter(())
    _check_frames(found, footage, path)
    found = _one_kind_of_tracks(found, path, run)
    timeline = None if footage is None or options.fps else footage.timeline
    looks = looks_of(found, options.rate_hz, fps if timeline is None else timeline.time_s)
    return _shown(looks, job)


def looks_of(
    found: Detections, rate_hz: float, times: float | Float[np.ndarray, "k"]
) -> Iterator[Look]:
    """Annotated boxes as looks: the first annotated frame in each slot of the rate.

    ``times`` is the frame rate, or the times of all frames of the footage. A slot without an
    annotated frame counts as analysed and empty. Pauses too long to be bridged are skipped; only
    their ends are kept.
    """
    if not len(found):
        return
    times_of: TimesOf = (lambda f: f / times) if isinstance(times, float) else (lambda f: times[f])
    frames = _slots(np.unique(found.frame), times_of, rate_hz)
    found = found.select(np.isin(found.frame, frames))
    found = found.select(np.argsort(found.frame, kind="stable"))
    found = replace(found, time_s=times_of(found.frame))
    for begin in range(0, len(frames), _FRAMES_PER_LOOK):
        some = frames[begin : begin + _FRAMES_PER_LOOK]
        rows = np.arange(*np.searchsorted(found.frame, [some[0], some[-1] + 1]))
        yield Look(some, times_of(some), found.select(rows))


def _shown(looks: Iterator[Look], job: Job) -> Iterator[Look]:
    with job.progress.stage("Placing and following", None) as step:
        for look in looks:
            step(len(look.frame))
            yield look


def _check_frames(found: Detections, footage: Source | None, path: Path) -> None:
    last = int(found.frame.max())
    count = None if footage is None else footage.frame_count
    if count is not None and last >= count:
        raise InputError(
            f"{path}: annotates frame {last} (from 0), but the footage has {count} frames: is it "
            "the annotation of this footage?"
        )
    if not found.time_s.max() < LONGEST_S:
        raise InputError(
            f"{path}: annotates frame {last} (from 0), {found.time_s.max():.3g} s from the "
            f"start, expected less than {LONGEST_S:.0e} s"
        )


def _one_kind_of_tracks(found: Detections, path: Path, run: TrackRun) -> Detections:
    """Tracks for all boxes or for none; raises if a track occurs twice in a frame."""
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


def _slots(
    annotated: Int[np.ndarray, "n"], times_of: TimesOf, rate_hz: float
) -> Int[np.ndarray, "m"]:
    """Frames to use: in each 1/rate of a second the first annotated one, or else the first.

    ``annotated`` is ascending. Frames in a pause too long to be bridged are left out, so that the
    number of frames is bounded by the annotated ones and not by their time span.
    """
    pause_s = np.diff(times_of(annotated), append=np.inf)
    step = np.diff(annotated, append=annotated[-1:] + 1)
    count = np.where(pause_s <= SmoothingSettings.max_gap_s, step, 1)
    offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    everything = np.repeat(annotated, count) + offset
    slot = np.floor(times_of(everything) * rate_hz + 1e-6)
    order = np.lexsort([everything, offset > 0, slot])
    first = np.diff(slot[order], prepend=slot[:1] - 1) > 0
    return np.asarray(everything[order][first])
