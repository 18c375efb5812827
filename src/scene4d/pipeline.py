"""The one place that puts stages together: from footage to a calibration and its files."""

import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from scene4d.errors import InputError, OutputError, UnavailableError
from scene4d.model import Calibration, Camera, Detections, Lens, Orientation, write_json

if TYPE_CHECKING:
    from scene4d.perception.people import PeopleDetector
    from scene4d.video.frames import Frame, Source

POPULATION_SIGMA_M = 0.03
"""How well the mean height of the people in front of a camera is known beforehand."""
ROUGH_FRAMES = 12
"""So many frames give a camera good enough to tell the detector how large people are where."""

Advance = Callable[[int], None]


@runtime_checkable
class Progress(Protocol):
    """Who shows progress: a bar for every stage; ``total`` is None where it is unknown."""

    def stage(self, title: str, total: int | None) -> AbstractContextManager[Advance]:
        """Begin a stage; call the result with how many steps were done."""
        ...


class Silent:
    """Shows nothing."""

    def stage(self, title: str, total: int | None) -> AbstractContextManager[Advance]:
        """Begin a stage that nobody sees."""
        return nullcontext(lambda steps: None)


@dataclass(frozen=True)
class Options:
    """What a user may say about a calibration; the names are those of the command line."""

    lens: str | Path | None = None
    annotations: str | Path | None = None
    image_size: tuple[int, int] | None = None
    person_height_m: float = 1.70
    method: str = "joint"
    orientation: str | Path | Orientation = "auto"
    estimate_focal: bool = False
    frames: int | None = None
    seed: int = 0
    drop_invalid: bool = False
    lines: bool = True


@dataclass
class Run:
    """A calibration with what its report shows: a picture, times by stage, what was noticed."""

    calibration: Calibration
    source_name: str
    image_bgr: np.ndarray | None = None
    timings: dict[str, float] = field(default_factory=dict)


@dataclass
class _Seen:
    """What the footage showed."""

    detections: Detections
    frames: int
    edges: np.ndarray | None = None
    image_bgr: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)


def calibrate(
    source: str | Path | None,
    *,
    lens: str | Path | None = None,
    annotations: str | Path | None = None,
    image_size: tuple[int, int] | None = None,
    person_height_m: float = 1.70,
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
    are taken (with ``estimate_focal``, the distortion alone). ``orientation`` is ``"auto"``,
    ``"people"``, ``"network"``, a JSON file or an :class:`Orientation`. ``lines=False`` leaves
    the straight edges of the scene out. Raises :class:`InputError` for bad input (a camera that
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
    orientation = _orientation(options)
    if source is None:
        if options.annotations is None:
            raise InputError("nothing to calibrate from: give a SOURCE, or --annotations FILE")
        if options.image_size is None:
            raise InputError("annotations without a SOURCE need --image-size WxH")
        lens = _lens(options, options.image_size)
        with _timed(timings, "read annotations"):
            seen = _annotated(options, options.image_size, None)
        name = str(options.annotations)
    else:
        from scene4d.video.reader import open_source

        with open_source(source) as footage:
            if options.image_size not in (None, footage.image_size):
                w, h = footage.image_size
                raise InputError(f"--image-size does not agree with {footage.name}: {w}x{h}")
            lens = _lens(options, footage.image_size)
            seen = _watch(footage, lens, options, progress, timings)
            seen.notes.extend(footage.warnings)
            name = footage.name
    with _timed(timings, "solve"), progress.stage("Solving for the camera", None):
        calibration = _solved(seen, lens, options, orientation)
    return Run(calibration, name, seen.image_bgr, timings)


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

    ``image_bgr`` is a picture of the scene for the report.
    """
    timings: dict[str, float] = {}
    orientation, lens = _orientation(options), _lens(options, detections.image_size)
    seen = _Seen(detections, len(np.unique(detections.frame)), None, image_bgr, list(notes))
    _drop_stationary(seen)
    with _timed(timings, "solve"), progress.stage("Solving for the camera", None):
        calibration = _solved(seen, lens, options, orientation)
    return Run(calibration, source_name, image_bgr, timings)


def fetch_weights(progress: Progress) -> None:
    """Get the networks that are missing; raises as :func:`perception.weights.fetch_all`."""
    from scene4d.perception.weights import fetch_all, missing_weights

    if not missing_weights():
        fetch_all()  # checks those that are here
        return
    percent = 0

    def told(source: str, so_far: int, total: int) -> None:
        nonlocal percent
        now = 100 * so_far // total if total else percent
        step(now - percent)
        percent = now

    with progress.stage("Fetching the networks", 100) as step:
        fetch_all(told)


def _solved(
    seen: _Seen, lens: Lens | None, options: Options, orientation: Orientation | None
) -> Calibration:
    from scene4d.calibration import person_segments, solve_segments

    found = solve_segments(
        person_segments(seen.detections),
        image_size=seen.detections.image_size,
        person_height_m=options.person_height_m,
        orientation=orientation,
        method=options.method,
        lens=lens,
        estimate_focal=options.estimate_focal,
        lines_xyxy=seen.edges,
        population_sigma_m=POPULATION_SIGMA_M,
        systematics=True,
        seed=options.seed,
    )
    said = (*seen.notes, *found.warnings)
    return replace(found, frames=seen.frames, warnings=said)


def _orientation(options: Options) -> Orientation | None:
    chosen = options.orientation
    if isinstance(chosen, Orientation):
        return chosen
    if chosen == "network":
        raise UnavailableError(
            "the orientation network is not part of this version: use --orientation auto, or a "
            "JSON file with focal_px, tilt_deg and roll_deg"
        )
    return None if chosen in ("auto", "people") else Orientation.load(chosen)


def _lens(options: Options, image_size: tuple[int, int]) -> Lens | None:
    if options.lens is None:
        return None
    from scene4d.formats.cameras import read_lens

    return read_lens(options.lens, image_size=image_size)


def _annotated(options: Options, image_size: tuple[int, int], fps: float | None) -> _Seen:
    from scene4d.formats.annotations import read_annotations

    assert options.annotations is not None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        detections = read_annotations(
            options.annotations, image_size=image_size, fps=fps, drop_invalid=options.drop_invalid
        )
    notes = [f"{w.message}." for w in caught]
    return _Seen(detections, len(np.unique(detections.frame)), notes=notes)


def _watch(
    footage: "Source",
    lens: Lens | None,
    options: Options,
    progress: Progress,
    timings: dict[str, float],
) -> _Seen:
    """Look at sampled frames once: people, whether the camera moves, the scene's edges."""
    from scene4d.perception.lines import straight_edges
    from scene4d.video.background import Background
    from scene4d.video.motion import MotionMonitor

    people = None if options.annotations else _people_detector(footage, lens, options, progress)
    monitor = MotionMonitor(footage.image_size)
    expected = _expected_frames(footage, options)
    background = Background(footage.image_size, expected)
    parts: list[Detections] = []
    count = 0
    with _timed(timings, "decode and detect"), progress.stage("Watching people", expected) as step:
        for frame in _sampled(footage, options.frames):
            monitor.add(frame.image_bgr, frame.time_s)
            background.add(frame)
            if people is not None:
                parts.append(people.look(frame))
            count += 1
            step(1)
    if count == 0:
        raise InputError(f"{footage.name}: no frame could be read")
    verdict = monitor.verdict()
    if verdict.moved:
        raise InputError(f"{footage.name}: {verdict.reason}")
    if people is None:
        seen = _annotated(options, footage.image_size, footage.fps)
    else:
        seen = _Seen(Detections.concatenate(parts), count)
        _drop_stationary(seen)
    if verdict.reason is not None and count > 1:
        seen.notes.append(f"{verdict.reason[0].upper()}{verdict.reason[1:]}.")
    seen.image_bgr = background.image()
    if options.lines and options.method == "joint" and seen.image_bgr is not None:
        with _timed(timings, "edges"):
            hidden = None if background.is_median else seen.detections.box_xyxy
            seen.edges = straight_edges(seen.image_bgr, hidden)
    return seen


def _drop_stationary(seen: _Seen) -> None:
    from scene4d.perception.stationary import stationary

    still = stationary(seen.detections)
    if still.any():
        seen.detections = seen.detections.select(~still)
        seen.notes.append(
            f"{int(still.sum())} sightings that never move (mannequins, posters, reflections) "
            "were left out."
        )


def _sampled(footage: "Source", n: int | None) -> "Iterator[Frame]":
    from scene4d.video.sampling import sample_frames

    return sample_frames(footage, n)


def _expected_frames(footage: "Source", options: Options) -> int | None:
    from scene4d.video.sampling import expected_count

    return expected_count(footage, options.frames)


def _people_detector(
    footage: "Source", lens: Lens | None, options: Options, progress: Progress
) -> "PeopleDetector":
    """The default detector; where it needs tiles, a rough camera first tells it where."""
    from scene4d.perception.detectors.tiles import choose_tiles
    from scene4d.perception.detectors.yolox import YoloxDetector
    from scene4d.perception.people import PeopleDetector, detect_people

    fetch_weights(progress)
    people = PeopleDetector.default()
    many = _expected_frames(footage, options) or 0
    if footage.timeline is None or many < 3 * ROUGH_FRAMES:
        return people
    if len(choose_tiles(footage.image_size)) == 0:
        return people
    with progress.stage("A first look", ROUGH_FRAMES) as step:
        rough = detect_people(
            _sampled(footage, ROUGH_FRAMES),
            replace(people, tracker=None),
            progress=lambda done, found: step(1),
        )
    first = _solved(_Seen(rough, ROUGH_FRAMES), lens, replace(options, method="joint"), None)
    if not first or first.camera is None:
        return people
    assert isinstance(people.detector, YoloxDetector)
    camera, height_m = first.camera, options.person_height_m
    expecting = people.detector.expecting(lambda rows: person_px(camera, rows, height_m))
    return replace(people, detector=expecting)


def person_px(camera: Camera, rows: np.ndarray, person_height_m: float) -> np.ndarray:
    """Height in pixels of a person with feet at image ``rows``, mid-width; NaN: nobody can be."""
    middle = np.full(len(rows), (camera.image_size[0] - 1) / 2)
    xy, valid = camera.locate(camera.undistort(np.column_stack([middle, rows]).astype(float))[0])
    head, seen = camera.project(np.column_stack([xy, np.full(len(xy), person_height_m)]))
    height = np.asarray(rows, float) - camera.distort(head)[:, 1]
    return np.where(valid & seen & (height > 0), height, np.nan)


def write(result: Run, out_dir: str | Path, *, command: str | None, progress: Progress) -> Path:
    """Write camera.json, people.parquet, figures and report.html; returns the report's path.

    Raises :class:`OutputError` where the folder cannot be written. Everything is written beside
    its target first, so an earlier result survives a full disk or Ctrl-C; ``camera.json`` comes
    last, so a folder that has one is complete.
    """
    out = ensure_folder(out_dir)
    with _timed(result.timings, "report"), progress.stage("Drawing the report", None):
        try:
            with tempfile.TemporaryDirectory(dir=out, prefix=".scene4d-") as staging:
                try:
                    _write_all(result, Path(staging), command)
                except OutputError as error:
                    raise OutputError(str(error).replace(staging, str(out))) from error
                _move_into_place(Path(staging), out)
        except OSError as error:
            raise OutputError(f"{out}: cannot be written: {error.strerror}") from error
    return out / "report.html"


def _write_all(result: Run, folder: Path, command: str | None) -> None:
    from importlib.metadata import version

    from scene4d.formats.tables import write_people
    from scene4d.report import write_report

    found = result.calibration
    camera = found.camera
    write_report(
        folder,
        found,
        image_bgr=result.image_bgr,
        ground_sigma_m=None
        if camera is None or not found
        else lambda uv: found.ground_sigma_m(camera.distort(uv)),
        source_name=result.source_name,
        command=command,
        timings=result.timings,
        version=version("scene4d"),
    )
    write_people(folder / "people.parquet", people_table(found))
    write_json(folder / "camera.json", found.to_dict())


def _move_into_place(folder: Path, out: Path) -> None:
    """The old result goes as the new one comes; between the two there is no camera.json."""
    from scene4d.report import FIGURES

    (out / "figures").mkdir(exist_ok=True)
    (out / "camera.json").unlink(missing_ok=True)
    for name in (*(f"figures/{figure}.png" for figure in FIGURES), "report.html", "people.parquet"):
        if (folder / name).exists():
            (folder / name).replace(out / name)
        else:
            (out / name).unlink(missing_ok=True)
    (folder / "camera.json").replace(out / "camera.json")


def people_table(found: Calibration) -> dict[str, np.ndarray]:
    """Columns of ``people.parquet``: every segment, its residual, and whether it was an inlier."""
    segments = found.segments
    assert segments is not None
    n = len(segments)
    nowhere = np.full((n, 2), np.nan)
    on_ground = nowhere
    if found and found.camera is not None:
        on_ground = found.camera.locate(found.camera.undistort(segments.foot_uv)[0])[0]
    return {
        "frame": segments.frame,
        "time_s": segments.time_s,
        "track": segments.track,
        "foot_u": segments.foot_uv[:, 0],
        "foot_v": segments.foot_uv[:, 1],
        "head_u": segments.head_uv[:, 0],
        "head_v": segments.head_uv[:, 1],
        "x1": segments.box_xyxy[:, 0],
        "y1": segments.box_xyxy[:, 1],
        "x2": segments.box_xyxy[:, 2],
        "y2": segments.box_xyxy[:, 3],
        "score": segments.score,
        "from_box": segments.from_box,
        "x_m": on_ground[:, 0],
        "y_m": on_ground[:, 1],
        "residual": np.full(n, np.nan) if found.residual is None else found.residual,
        "inlier": np.zeros(n, bool) if found.inlier is None else found.inlier,
    }


def ensure_folder(path: str | Path) -> Path:
    """Make the output folder and see that it can be written, before any work is done."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".scene4d-writes-here"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error
    return folder


@contextmanager
def _timed(timings: dict[str, float], name: str) -> Iterator[None]:
    begun = time.perf_counter()
    yield
    timings[name] = timings.get(name, 0.0) + time.perf_counter() - begun
