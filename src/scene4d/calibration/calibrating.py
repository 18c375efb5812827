"""``calibrate``: the stages of a calibration, one after the other."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.orienting import OrientationReader, OrientationReading
from scene4d.calibration.watching import Seen, annotated, drop_stationary, solved, watch
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Progress, Silent, timed

if TYPE_CHECKING:
    from scene4d.video.frames import Source

_DEFAULT = CalibrateOptions()
NO_PICTURES = (
    "There are no images for the orientation network, so the camera is based on the people alone."
)


def calibrate(
    source: str | Path | None,
    options: CalibrateOptions = _DEFAULT,
    *,
    progress: Progress | None = None,
    **more: Any,
) -> Calibration:
    """Calibrate a fixed camera from footage of people walking; the result is false with a reason
    where the camera is undetermined.

    ``source`` is a video, an image, a folder of images, a glob or a stream URL; None with the
    options ``annotations`` and ``image_size``. Options are those of :class:`CalibrateOptions`, in
    one or by their names: ``calibrate("street.mp4", person_height_m=1.65)``. Raises
    :class:`InputError` for bad input (a camera that moves is one) and
    :class:`UnavailableError` where weights cannot be had.
    """
    return run(source, replace(options, **more), progress or Silent()).calibration


@dataclass
class Run:
    """A calibration with what its report shows: the scene, a frame with people, times by stage,
    and what the orientation network read, where it was asked.
    """

    calibration: Calibration
    source_name: str
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    reading: OrientationReading | None = None
    timings: dict[str, float] = field(default_factory=dict)


def run(
    source: str | Path | None,
    options: CalibrateOptions,
    progress: Progress,
    *,
    command: str | None = None,
) -> Run:
    """All stages of a calibration, with everything that the report needs; ``command`` is how it
    was asked for, for the record.
    """
    if source is None:
        return _run_annotations(options, progress, command)
    from scene4d.video.reader import open_source

    with open_source(source) as footage:
        return run_footage(footage, options, progress, command=command)


def run_footage(
    footage: "Source",
    options: CalibrateOptions,
    progress: Progress,
    *,
    command: str | None = None,
) -> Run:
    """As :func:`run`, from footage that is open."""
    timings: dict[str, float] = {}
    if options.image_size not in (None, footage.image_size):
        w, h = footage.image_size
        raise InputError(f"image_size does not agree with {footage.name}: {w}x{h}")
    options = options.read(footage.image_size)
    seen = watch(footage, options, progress, timings)
    seen.notes.extend(footage.warnings)
    return _finished(seen, options, footage.name, progress, timings, command)


def run_detections(
    detections: Detections,
    options: CalibrateOptions,
    progress: Progress,
    source_name: str,
    *,
    image_bgr: np.ndarray | None = None,
    notes: tuple[str, ...] = (),
    command: str | None = None,
) -> Run:
    """As :func:`run`, from people that were detected before; ``notes`` become warnings.

    ``image_bgr`` is a picture of the scene for the report and for the orientation network.
    """
    timings: dict[str, float] = {}
    options = options.read(detections.image_size)
    seen = Seen(detections, len(np.unique(detections.frame)), image_bgr=image_bgr)
    seen.notes.extend(notes)
    drop_stationary(seen)
    if image_bgr is None:
        _without_pictures(seen, options)
    elif options.uses_network:
        with timed(timings, "orientation"):
            known = not options.estimate_focal
            reader = OrientationReader(detections.image_size, options.known_lens, focal_known=known)
            reader.look(0, image_bgr)
            seen.reading = reader.reading()
    return _finished(seen, options, source_name, progress, timings, command)


def _run_annotations(options: CalibrateOptions, progress: Progress, command: str | None) -> Run:
    if options.annotations is None:
        raise InputError("nothing to calibrate from: give a source or annotations")
    if options.image_size is None:
        raise InputError("annotations without a source need image_size")
    size = options.image_size
    options = options.read(size)
    timings: dict[str, float] = {}
    with timed(timings, "read annotations"):
        seen = annotated(options, size, None)
    _without_pictures(seen, options)
    return _finished(seen, options, str(options.annotations), progress, timings, command)


def _without_pictures(seen: Seen, options: CalibrateOptions) -> None:
    """Note that the network could not be asked; raises :class:`InputError` where it is needed."""
    if options.needs_network:
        why = "the paper's method" if options.method == "paper" else 'orientation "network"'
        raise InputError(
            f"{why} needs pictures for the orientation network to look at, and there are "
            "annotations alone: give a source as well, or an orientation file"
        )
    if options.uses_network:
        seen.notes.append(NO_PICTURES)


def _finished(
    seen: Seen,
    options: CalibrateOptions,
    source_name: str,
    progress: Progress,
    timings: dict[str, float],
    command: str | None,
) -> Run:
    with timed(timings, "solve"), progress.stage("Solving for the camera", None):
        found = solved(seen, options)
    made = {
        "source": source_name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": version("scene4d"),
    }
    found = replace(found, made=made if command is None else made | {"command": command})
    return Run(found, source_name, seen.image_bgr, seen.people_bgr, seen.reading, timings)
