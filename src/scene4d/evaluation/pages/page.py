"""The page of an evaluation: words, table and figures in one self-contained file."""

from collections.abc import Mapping
from typing import Any

from scene4d.core.camera import Camera
from scene4d.drawing.page import Shown, data_uri, rendered, seconds_text
from scene4d.drawing.words import number
from scene4d.evaluation import Evaluation

_TITLES = {"pets": "PETS 2009", "towncentre": "TownCentre", "virat": "VIRAT"}


def render_evaluation(
    evaluation: Evaluation,
    pictures: Mapping[str, bytes],
    *,
    command: str | None,
    version: str | None,
    timings: Mapping[str, float],
) -> str:
    """The page as HTML, with the ``pictures`` (of :func:`.draw_evaluation`) inside it.

    Angles are in degrees; ``timings`` are seconds by stage.
    """
    from scene4d.evaluation.pages.captions import HEADINGS, caption, words_for_picture
    from scene4d.evaluation.pages.few import few_line
    from scene4d.evaluation.pages.headline import RULE, headlines
    from scene4d.evaluation.pages.summary import paragraphs, verdict
    from scene4d.evaluation.pages.table import table

    figures = {
        name: Shown(name, data_uri(png), words_for_picture(name), caption(name, evaluation))
        for name, png in pictures.items()
    }
    values: dict[str, Any] = {
        "title": _TITLES.get(evaluation.name, evaluation.reference.name),
        "verdict": verdict(evaluation),
        "paragraphs": paragraphs(evaluation),
        "table": table(evaluation),
        "few": [few_line(row) for row in evaluation.few],
        "notes": [*evaluation.notes, *_missing(evaluation)],
        "rule": RULE if headlines(evaluation) and len(evaluation.settings()) > 1 else "",
        "headings": HEADINGS,
        "figures": figures,
        "has_camera": isinstance(evaluation.reference.truth, Camera),
        "provenance": _provenance(evaluation, command, version),
        "timings": [(name, seconds_text(s)) for name, s in timings.items()],
    }
    return rendered("scene4d.evaluation.pages", "evaluation.html.j2", values)


def _missing(evaluation: Evaluation) -> list[str]:
    """Why figures that a reader of the paper expects are not here."""
    from scene4d.evaluation.pages.headline import headlines

    methods = {s.method for s in headlines(evaluation)}
    asked = {setting.method for setting in evaluation.settings()}
    said = [
        f"The {name} has no result that counts, so the figures are drawn without it."
        for method, name in (("paper", "paper’s method"), ("joint", "joint method"))
        if method in asked - methods
    ]
    if evaluation.image_bgr is None:
        said.append(
            "There is no picture of the scene: figures that need one lie on a plain ground."
        )
    return said


def _provenance(
    evaluation: Evaluation, command: str | None, version: str | None
) -> list[tuple[str, str]]:
    reference = evaluation.reference
    from scene4d.evaluation.pages.captions import walked

    width, height = reference.image_size
    kind = "camera" if isinstance(reference.truth, Camera) else "homography of the ground"
    rows = [
        ("Data set", evaluation.name),
        ("Reference", f"{reference.name}: {kind}"),
        ("Image size", f"{width} × {height} pixels"),
        ("Correspondence points", str(len(reference.points_uv))),
        (
            "Feet on the ground" if walked(evaluation) else "Points on the ground",
            number(float(len(reference.walked_uv)), 0),
        ),
        ("Lines", f"{len(evaluation.settings())}, {len(evaluation.outcomes)} calibrations"),
        (
            "Paper",
            "Wagner, Crispell, Feeney, Mundy (2019), 4-D Scene Alignment in Surveillance Video",
        ),
    ]
    if version is not None:
        rows.append(("scene4d", version))
    if command is not None:
        rows.append(("Command", command))
    return rows
