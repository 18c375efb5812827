"""The report: PNG figures beside one HTML page that carries everything inside itself."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import OutputError
from scene4d.core.files import write_bytes
from scene4d.drawing.page import Shown, data_uri, rendered, seconds_text
from scene4d.drawing.words import number, parameter_rows, rounded_m, verdict

FIGURES: tuple[str, ...] = ("overlay", "birdseye", "errormap", "heights")
"""Names of the figures, ``figures/NAME.png``; only the first where there is no camera."""


def write_report(
    out_dir: str | os.PathLike[str],
    calibration: Calibration,
    *,
    image_bgr: np.ndarray | None = None,
    people_bgr: np.ndarray | None = None,
    ground_sigma_m: Callable[[np.ndarray], np.ndarray] | None = None,
    network: Camera | None = None,
    source_name: str = "footage",
    command: str | None = None,
    timings: Mapping[str, float] | None = None,
    version: str | None = None,
) -> Path:
    """Write ``figures/*.png`` and then ``report.html`` into ``out_dir``; returns the page's path.

    ``image_bgr`` is the scene as decoded (h, w, 3) uint8, ``people_bgr`` a frame with people in it
    for the first figure (else the scene serves), ``ground_sigma_m`` maps pixels of the footage
    (n, 2) to the predicted radial error (n,) in metres, NaN above the horizon; ``network`` is a
    camera, of whatever height, as the orientation network reads it; ``timings`` are seconds by
    stage. All figures are drawn before the first file is written; figures of an earlier report that
    this one lacks are removed. Raises :class:`InputError` for a frame of another size,
    :class:`OutputError` where the folder cannot be written.
    """
    from scene4d.drawing.style import checked_image

    image = checked_image(image_bgr, calibration.image_size)
    people = image if people_bgr is None else checked_image(people_bgr, calibration.image_size)
    pictures = _draw(calibration, image, people, ground_sigma_m, network)
    provenance = _provenance(calibration, source_name, command, version)
    page = _render(calibration, pictures, provenance, timings or {}, network is not None)
    folder = _folder(Path(out_dir))
    for name in FIGURES:
        path = folder / "figures" / f"{name}.png"
        if name in pictures:
            write_bytes(path, pictures[name])
        else:
            _remove(path)
    write_bytes(folder / "report.html", page.encode())
    return folder / "report.html"


def _folder(path: Path) -> Path:
    try:
        (path / "figures").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
    return path


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be removed: {error.strerror}") from error


def _draw(
    calibration: Calibration,
    image: np.ndarray | None,
    people: np.ndarray | None,
    ground_sigma_m: Callable[[np.ndarray], np.ndarray] | None,
    network: Camera | None,
) -> dict[str, bytes]:
    from scene4d.calibration.report.errormap import draw_error_map
    from scene4d.drawing.birdseye import draw_birdseye
    from scene4d.drawing.histogram import draw_histogram
    from scene4d.drawing.overlay import draw_overlay

    pictures = {"overlay": draw_overlay(calibration, people, network)}
    if not calibration or calibration.camera is None:
        return pictures
    above = draw_birdseye(calibration, image)
    if above is not None:
        pictures["birdseye"] = above
    if ground_sigma_m is not None:
        pictures["errormap"] = draw_error_map(calibration, ground_sigma_m, image)
    if calibration.inliers:
        pictures["heights"] = draw_histogram(calibration)
    return pictures


def _render(
    calibration: Calibration,
    pictures: Mapping[str, bytes],
    provenance: list[tuple[str, str]],
    timings: Mapping[str, float],
    has_network: bool,
) -> str:
    from scene4d.calibration.report.captions import caption, words_for_picture

    figures = {
        name: Shown(
            name,
            data_uri(content),
            words_for_picture(name, calibration),
            caption(name, calibration, has_network=has_network),
        )
        for name, content in pictures.items()
    }
    values: dict[str, Any] = {
        "ok": bool(calibration) and calibration.camera is not None,
        "verdict": verdict(calibration),
        "parameters": parameter_rows(calibration),
        "warnings": calibration.warnings,
        "figures": figures,
        "has_sigma": calibration.covariance is not None,
        "provenance": provenance,
        "timings": [(name, seconds_text(s)) for name, s in timings.items()],
        "person_height": f"{calibration.person_height_m:.2f}",
        "title": provenance[0][1],
    }
    return rendered("scene4d.calibration.report", "report.html.j2", values)


def _provenance(
    calibration: Calibration, source_name: str, command: str | None, version: str | None
) -> list[tuple[str, str]]:
    width, height = calibration.image_size
    rows = [
        ("Source", source_name),
        ("Image size", f"{width} × {height} pixels"),
        ("Frames used", str(calibration.frames)),
        ("People", f"{number(float(calibration.people), 0)} sightings"),
    ]
    if calibration and calibration.people:
        share = f"{calibration.inliers / calibration.people:.0%}"
        rows.append(("Inliers", f"{number(float(calibration.inliers), 0)} ({share})"))
    rows.append(("Method", calibration.method))
    rows.append(("Assumed mean height", f"{calibration.person_height_m:.2f} m"))
    error = calibration.ground_error_m or {}
    if calibration and np.isfinite(error.get("median", np.nan)):
        text = f"median {rounded_m(error['median'])}"
        if np.isfinite(error.get("p90", np.nan)):
            text += f", 90 % of places below {rounded_m(error['p90'])}"
        rows.append(("Predicted ground error", text))
    if version is not None:
        rows.append(("scene4d", version))
    if command is not None:
        rows.append(("Command", command))
    return rows
