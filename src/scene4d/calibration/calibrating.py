"""``calibrate``: the stages of a calibration, one after the other."""

from pathlib import Path

import numpy as np

from scene4d.calibration.options import Options, Run, Seen
from scene4d.calibration.orienting import OrientationReader
from scene4d.calibration.solving import (
    check_pictures,
    solved,
    told_lens,
    told_orientation,
    without_pictures,
)
from scene4d.calibration.watching import annotated, drop_stationary, watch
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import PERSON_HEIGHT_M, Detections
from scene4d.core.progress import Progress, Silent, timed


def calibrate(
    source: str | Path | None,
    *,
    lens: str | Path | None = None,
    annotations: str | Path | None = None,
    image_size: tuple[int, int] | None = None,
    person_height_m: float = PERSON_HEIGHT_M,
    method: str = "joint",
    orientation: str | Path | Orientation = "auto",
    estimate_focal: bool = False,
    frames: int | None = None,
    seed: int = 0,
    drop_invalid: bool = False,
    lines: bool = True,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a fixed camera from footage of people walking; the result is false with a reason
    where the camera is undetermined.

    ``source`` is a video, an image, a folder of images, a glob or a stream URL; None with
    ``annotations`` and ``image_size``. ``lens`` is a camera file whose intrinsics and distortion
    are taken (with ``estimate_focal``, the distortion alone). ``orientation`` is ``"auto"`` (the
    orientation network's reading is a guess that the people may overrule), ``"people"`` (without
    it), ``"network"`` (it is believed), a JSON file or an :class:`Orientation`; the paper's method
    takes the network's alone for the first and the third. ``lines=False`` leaves the straight edges
    of the scene out. Raises :class:`InputError` for bad input (a camera that
    moves is one) and :class:`UnavailableError` where weights cannot be had.
    """
    options = Options(
        lens, annotations, image_size, person_height_m, method, orientation, estimate_focal,
        frames, seed, drop_invalid, lines,
    )  # fmt: skip
    return run(source, options, progress or Silent()).calibration


def run(source: str | Path | None, options: Options, progress: Progress) -> Run:
    """All stages of a calibration, with everything that the report needs."""
    timings: dict[str, float] = {}
    orientation = told_orientation(options)
    if source is None:
        if options.annotations is None:
            raise InputError("nothing to calibrate from: give a SOURCE, or --annotations FILE")
        if options.image_size is None:
            raise InputError("annotations without a SOURCE need --image-size WxH")
        check_pictures(options)
        lens = told_lens(options, options.image_size)
        with timed(timings, "read annotations"):
            seen = annotated(options, options.image_size, None)
        without_pictures(seen, options)
        name = str(options.annotations)
    else:
        from scene4d.video.reader import open_source

        with open_source(source) as footage:
            if options.image_size not in (None, footage.image_size):
                w, h = footage.image_size
                raise InputError(f"--image-size does not agree with {footage.name}: {w}x{h}")
            lens = told_lens(options, footage.image_size)
            seen = watch(footage, lens, options, progress, timings)
            seen.notes.extend(footage.warnings)
            name = footage.name
    with timed(timings, "solve"), progress.stage("Solving for the camera", None):
        calibration = solved(seen, lens, options, orientation)
    return Run(calibration, name, seen.image_bgr, seen.people_bgr, seen.reading, timings)


def run_detections(
    detections: Detections,
    options: Options,
    progress: Progress,
    source_name: str,
    *,
    image_bgr: np.ndarray | None = None,
    notes: tuple[str, ...] = (),
) -> Run:
    """As :func:`run`, from people that were detected before; ``notes`` become warnings.

    ``image_bgr`` is a picture of the scene for the report and for the orientation network.
    """
    timings: dict[str, float] = {}
    orientation, lens = told_orientation(options), told_lens(options, detections.image_size)
    seen = Seen(detections, len(np.unique(detections.frame)), image_bgr=image_bgr)
    seen.notes.extend(notes)
    drop_stationary(seen)
    if image_bgr is None:
        check_pictures(options)
        without_pictures(seen, options)
    elif options.uses_network:
        with timed(timings, "orientation"):
            reader = OrientationReader(
                detections.image_size, lens, focal_known=not options.estimate_focal
            )
            reader.look(0, image_bgr)
            seen.reading = reader.reading()
    with timed(timings, "solve"), progress.stage("Solving for the camera", None):
        calibration = solved(seen, lens, options, orientation)
    return Run(calibration, source_name, image_bgr, reading=seen.reading, timings=timings)
