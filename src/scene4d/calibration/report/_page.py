"""The report: PNG figures beside one HTML page that carries everything inside itself."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.landmarks import LandmarkFit
from scene4d.drawing.page import as_shown, rendered, seconds_text
from scene4d.drawing.words import ground_error_texts, number, parameter_rows, verdict

if TYPE_CHECKING:
    from scene4d.calibration.calibrating import Run
    from scene4d.drawing.style import Drawn

FIGURES: tuple[str, ...] = ("overlay", "birdseye", "errormap", "heights")
"""Names of the figures, ``figures/NAME.png``; only the first where there is no camera."""


def report_files(run: "Run") -> dict[str, bytes]:
    """The content of ``report.html`` and of the ``figures/*.png`` by their names.

    Raises :class:`InputError` for a frame of another size than the calibration's.
    """
    network = None if run.reading is None else run.reading.camera
    pictures = _draw(run, network)
    files = {f"figures/{name}.png": figure.png for name, figure in pictures.items()}
    return files | {"report.html": _render(run, pictures, network).encode()}


def _draw(run: "Run", network: Camera | None) -> "dict[str, Drawn]":
    from scene4d.calibration.report._errormap import draw_error_map
    from scene4d.drawing.birdseye import draw_birdseye
    from scene4d.drawing.histogram import draw_histogram
    from scene4d.drawing.overlay import draw_overlay
    from scene4d.drawing.style import checked_image

    calibration = run.calibration
    image = checked_image(run.image_bgr, calibration.image_size)
    people = checked_image(run.people_bgr, calibration.image_size)
    people = image if people is None else people
    pictures = {"overlay": draw_overlay(calibration, people, network)}
    if not calibration or calibration.camera is None:
        return pictures
    above = draw_birdseye(calibration, image)
    if above is not None:
        pictures["birdseye"] = above
    if calibration.covariance is not None and calibration.segments is not None:
        pictures["errormap"] = draw_error_map(calibration, image)
    if calibration.inliers:
        pictures["heights"] = draw_histogram(calibration)
    return pictures


def _render(run: "Run", pictures: "Mapping[str, Drawn]", network: Camera | None) -> str:
    from scene4d.calibration.report._captions import caption, words_for_picture

    calibration = run.calibration
    figures = as_shown(
        pictures,
        lambda name: words_for_picture(name, calibration),
        lambda name: caption(name, calibration, network),
    )
    values: dict[str, Any] = {
        "ok": bool(calibration) and calibration.camera is not None,
        "verdict": verdict(calibration),
        "errors": ground_error_texts(calibration) if calibration else [],
        "parameters": parameter_rows(calibration),
        "warnings": calibration.warnings,
        "levels": bool(calibration.ground_regions),
        "landmarks": _landmarks(calibration.landmarks) if calibration.landmarks else [],
        "stands": _stands(calibration.landmarks) if calibration.landmarks else "",
        "figures": figures,
        "has_sigma": calibration.covariance is not None,
        "provenance": _provenance(calibration, run.source_name),
        "timings": [(name, seconds_text(s)) for name, s in run.timings.items()],
        "person_height": f"{calibration.person_height_m:.2f}",
        "title": run.source_name,
    }
    return rendered("scene4d.calibration.report", "report.html.j2", values)


def _landmarks(fit: LandmarkFit) -> list[tuple[str, str, str, str]]:
    """Name, sigmas off, metres off and use of every landmark."""
    uses = ("left out", "used")
    return [
        (name, number(float(sigmas), 1), f"{number(float(off_m), 2)} m", uses[int(used)])
        for name, sigmas, off_m, used in zip(
            fit.landmarks.names(), fit.off_sigmas, fit.off_m, fit.used, strict=True
        )
    ]


def _stands(fit: LandmarkFit) -> str:
    """Where the camera stands in the frame of the ground points."""
    if fit.camera_xy_m is None or fit.heading_rad is None:
        return ""
    x, y = (number(value, 2) for value in fit.camera_xy_m)
    heading = number(float(np.degrees(fit.heading_rad)) % 360, 1)
    return (
        f"In the frame of the ground points the camera stands at ({x}, {y}) m and looks towards "
        f"{heading}°, counted from x towards y."
    )


def _provenance(calibration: Calibration, source_name: str) -> list[tuple[str, str]]:
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
    if calibration.vehicles is not None:
        of = f"{calibration.vehicle_count}, {len(calibration.vehicles)} sightings"
        rows.append(("Vehicles used", of))
    rows.append(("Method", calibration.method))
    rows.append(("Assumed mean height", f"{calibration.person_height_m:.2f} m"))
    made = calibration.made or {}
    titles = {"date": "Date", "version": "scene4d", "command": "Command"}
    return rows + [(title, made[name]) for name, title in titles.items() if name in made]
