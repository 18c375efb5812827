"""The files of a calibration, all of them or none."""

from pathlib import Path

import numpy as np

from scene4d.calibration.calibrating import Run
from scene4d.calibration.orienting import OrientationReading
from scene4d.core.calibration import Calibration
from scene4d.core.files import write_bytes, write_json
from scene4d.core.pictures import jpeg
from scene4d.core.progress import Progress, timed
from scene4d.core.staging import ensure_folder, staged

BACKGROUND = "background.jpg"
"""The scene as it was calibrated: by it ``track`` sees whether the camera has moved since."""
_QUALITY = 92


def write(result: Run, out_dir: str | Path, *, progress: Progress) -> Path:
    """Write camera.json, people.parquet, figures and report.html; returns the report's path.

    All of them or none (:func:`.staged`); ``camera.json`` comes last. Raises :class:`OutputError`
    where the folder cannot be written.
    """
    from scene4d.calibration.report._page import FIGURES, report_files
    from scene4d.core.tables import write_people

    found, out = result.calibration, ensure_folder(out_dir)
    figures = (f"figures/{figure}.png" for figure in FIGURES)
    names = [*figures, "report.html", "people.parquet", BACKGROUND]
    with (
        timed(result.timings, "report"),
        progress.stage("Drawing the report", None),
        staged(out, names, last="camera.json") as folder,
    ):
        (folder / "figures").mkdir()
        for name, content in report_files(result).items():
            write_bytes(folder / name, content)
        write_people(folder / "people.parquet", _people_table(found))
        if result.image_bgr is not None and found:
            write_bytes(folder / BACKGROUND, jpeg(result.image_bgr, _QUALITY))
        write_json(folder / "camera.json", found.to_dict())
    return out / "report.html"


def write_orientation(
    reading: OrientationReading, out_dir: str | Path, *, progress: Progress
) -> Path:
    """Write orientation.json and figures/orientation.png; returns the figure's path.

    Both or none (:func:`.staged`). Raises :class:`OutputError` where the folder cannot be written.
    """
    from scene4d.calibration.report._orientation import draw_orientation

    out, name = ensure_folder(out_dir), "figures/orientation.png"
    with (
        progress.stage("Drawing the orientation", None),
        staged(out, [name], last="orientation.json") as folder,
    ):
        picture = draw_orientation(
            reading.belief,
            reading.camera,
            reading.image_bgr,
            focal_known=reading.focal_known,
            frames=reading.frames,
        )
        (folder / "figures").mkdir()
        write_bytes(folder / name, picture)
        write_json(folder / "orientation.json", reading.to_dict())
    return out / name


def _people_table(found: Calibration) -> dict[str, np.ndarray]:
    """Columns of ``people.parquet``: every segment, its residual, and whether it was an inlier."""
    segments = found.segments
    assert segments is not None
    n = len(segments)
    nowhere = np.full((n, 2), np.nan)
    on_ground = nowhere
    if found and found.camera is not None:
        foot_m = found.ground_height_m(segments.foot_uv)[0] + segments.foot_height_m
        on_ground = found.camera.locate(segments.foot_uv, foot_m)[0]
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
