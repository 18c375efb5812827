"""The page of an evaluation: words, table and figures in one self-contained file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scene4d.core.camera import Camera
from scene4d.core.files import write_bytes, write_json
from scene4d.core.progress import Progress
from scene4d.core.staging import ensure_folder, staged
from scene4d.drawing.page import as_shown, made_by, rendered
from scene4d.drawing.style import Drawn
from scene4d.drawing.words import number
from scene4d.evaluation.pages._activities import render_activities
from scene4d.evaluation.pages._charts import draw_det, draw_near, draw_roc, roc_curves
from scene4d.evaluation.pages._headline import RULE, headlines
from scene4d.evaluation.pages._pictures import (
    draw_alignment,
    draw_consensus,
    draw_ground,
    draw_points,
)
from scene4d.evaluation.pages._rings import draw_rings
from scene4d.evaluation.pages._table import table
from scene4d.evaluation.pages._words import HEADINGS, alternative, caption, paragraphs, verdict
from scene4d.evaluation.pages.site import draw_site, render_site
from scene4d.evaluation.trials.activities import ActivityEvaluation
from scene4d.evaluation.trials.outcomes import Evaluation
from scene4d.evaluation.trials.sites import SiteEvaluation

FIGURES: tuple[str, ...] = (*HEADINGS, "det", "site_plan", "site_people")
"""Names of all figures, in the order of the page; those without data are left out."""
_TITLES = {"pets": "PETS 2009", "towncentre": "TownCentre", "virat": "VIRAT"}


def write_evaluation(
    evaluation: Evaluation | ActivityEvaluation | SiteEvaluation,
    out_dir: str | Path,
    *,
    command: str | None,
    progress: Progress,
) -> Path:
    """Write ``evaluation.html``, ``figures/*.png`` and ``evaluation.json``; returns the page.

    All of them or none (:func:`.staged`). Raises :class:`OutputError` where the folder cannot be
    written.
    """
    out = ensure_folder(out_dir)
    names = [*(f"figures/{name}.png" for name in FIGURES), "evaluation.html"]
    with (
        progress.stage("Drawing the evaluation", None),
        staged(out, names, last="evaluation.json") as folder,
    ):
        if isinstance(evaluation, ActivityEvaluation):
            pictures = {"det": draw_det(evaluation)}
            page = render_activities(evaluation, pictures, command=command)
        elif isinstance(evaluation, SiteEvaluation):
            pictures = draw_site(evaluation)
            page = render_site(evaluation, pictures, command=command)
        else:
            pictures = draw_evaluation(evaluation)
            page = render_evaluation(evaluation, pictures, command=command)
        (folder / "figures").mkdir()
        for name, picture in pictures.items():
            write_bytes(folder / "figures" / f"{name}.png", picture.png)
        write_bytes(folder / "evaluation.html", page.encode())
        write_json(folder / "evaluation.json", evaluation.to_dict())
    return out / "evaluation.html"


def draw_evaluation(evaluation: Evaluation) -> dict[str, Drawn]:
    """Figures by name, in the order of :data:`FIGURES`, that can be drawn.

    ``headline.RULE`` says which outcomes stand for a method. Raises :class:`InputError` for a
    picture of another size than the footage, and where there are too few correspondence points.
    """
    shown = headlines(evaluation)
    drawn: dict[str, Drawn] = {}
    if evaluation.image_bgr is not None:
        drawn["points"] = draw_points(evaluation)
    for s in shown:
        found = s.calibration
        if s.method == "paper" and found.segments is not None and found.inlier is not None:
            drawn["consensus"] = draw_consensus(evaluation, s)
        drawn[s.ground_figure] = draw_ground(evaluation, s)
    if shown:
        drawn["alignment"] = draw_alignment(shown)
        drawn["near"] = draw_near(shown)
        rings = None if evaluation.image_bgr is None else draw_rings(evaluation, shown)
        if rings is not None:
            drawn["rings"] = rings
    if any(roc_curves(evaluation, s) for s in shown):
        drawn["roc"] = draw_roc(evaluation, shown)
    return {name: drawn[name] for name in FIGURES if name in drawn}


def render_evaluation(
    evaluation: Evaluation, pictures: Mapping[str, Drawn], *, command: str | None
) -> str:
    """The page as HTML, with the ``pictures`` (of :func:`draw_evaluation`) inside it."""
    values: dict[str, Any] = {
        "title": _TITLES.get(evaluation.name, evaluation.reference.name),
        "verdict": verdict(evaluation),
        "paragraphs": paragraphs(evaluation),
        "table": table(evaluation),
        "notes": [*evaluation.notes, *_missing(evaluation)],
        "rule": RULE if headlines(evaluation) and len(evaluation.settings()) > 1 else "",
        "headings": HEADINGS,
        "figures": as_shown(pictures, alternative, lambda name: caption(name, evaluation)),
        "has_camera": isinstance(evaluation.reference.truth, Camera),
        "provenance": _provenance(evaluation, command),
        "timings": [],
    }
    return rendered("scene4d.evaluation.pages", "evaluation.html.j2", values)


def _missing(evaluation: Evaluation) -> list[str]:
    """Why figures that a reader of the paper expects are not here."""
    methods = {s.method for s in headlines(evaluation)}
    asked = {setting.method for setting in evaluation.settings()}
    said = [
        f"The {name} has no result that counts, so the figures are drawn without it."
        for method, name in (("paper", "paper’s method"), ("joint", "joint method"))
        if method in asked - methods
    ]
    if evaluation.image_bgr is None:
        said.append("There is no picture of the scene: the ground is drawn on a plain canvas.")
    return said


def _provenance(evaluation: Evaluation, command: str | None) -> list[tuple[str, str]]:
    reference = evaluation.reference
    width, height = reference.image_size
    kind = "camera" if isinstance(reference.truth, Camera) else "homography of the ground"
    return [
        ("Data set", evaluation.name),
        ("Reference", f"{reference.name}: {kind}"),
        ("Image size", f"{width} × {height} pixels"),
        ("Correspondence points", str(len(reference.points_uv))),
        ("Points on the ground", number(float(len(reference.walked_uv)), 0)),
        ("Lines", f"{len(evaluation.settings())}, {len(evaluation.outcomes)} calibrations"),
        (
            "Paper",
            "Wagner, Crispell, Feeney, Mundy (2019), 4-D Scene Alignment in Surveillance Video",
        ),
        *made_by(command),
    ]
