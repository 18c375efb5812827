"""The report: PNG figures beside one HTML page that carries everything inside itself."""

import base64
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.errors import OutputError
from scene4d.model import Calibration, Camera, write_bytes
from scene4d.report.words import number, parameter_rows, rounded_m, verdict

FIGURES: tuple[str, ...] = ("overlay", "birdseye", "errormap", "heights")
"""Names of the figures, ``figures/NAME.png``; only the first where there is no camera."""
EMBED_BYTES = 520_000
"""Most that one figure takes inside the page; the PNG files keep everything."""


@dataclass(frozen=True)
class Shown:
    """A figure as the page shows it."""

    name: str
    uri: str
    alt: str
    caption: str


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
    for the first figure (else the scene serves), ``ground_sigma_m`` maps undistorted
    pixels (n, 2) to the predicted radial error (n,) in metres, NaN above the horizon; ``network``
    is a camera, of whatever height, as the orientation network reads it; ``timings`` are seconds by
    stage. All figures are drawn before the first file is written; figures of an
    earlier report that this one lacks are removed. Raises :class:`InputError` for a frame of
    another size, :class:`OutputError` where the folder cannot be written.
    """
    from scene4d.report.style import checked_image

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
    from scene4d.report.birdseye import draw_birdseye
    from scene4d.report.errormap import draw_error_map
    from scene4d.report.histogram import draw_histogram
    from scene4d.report.overlay import draw_overlay

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
    from scene4d.report.captions import caption, words_for_picture

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
    return rendered("report.html.j2", values)


def rendered(template: str, values: Mapping[str, Any]) -> str:
    """A page from its template; a value that the template wants and nobody gave is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("scene4d.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(values)


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


def seconds_text(seconds: float) -> str:
    """Seconds to a tenth; what is shorter is not shown as nothing."""
    return f"{seconds:.1f}" if seconds >= 0.05 else "below 0.1"


def data_uri(png: bytes) -> str:
    """A ``data:`` URI of the picture: the PNG where it is small, else a JPEG of full colour.

    The quality falls until the picture fits :data:`EMBED_BYTES`, but not below 60.
    """
    if len(png) <= EMBED_BYTES / 2:
        return "data:image/png;base64," + base64.b64encode(png).decode()
    import cv2

    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    full_colour = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    jpeg = b""
    for quality in (90, 82, 72, 60):
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, *full_colour]
        jpeg = cv2.imencode(".jpg", pixels, options)[1].tobytes()
        if len(jpeg) <= EMBED_BYTES:
            break
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
