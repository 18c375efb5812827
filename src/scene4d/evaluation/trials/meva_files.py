"""The files of an evaluation of activity search."""

from pathlib import Path

from scene4d.core.files import write_bytes, write_json
from scene4d.core.progress import Progress
from scene4d.core.staging import ensure_folder, staged
from scene4d.evaluation.activity_evaluation import ActivityEvaluation


def write_activities(
    evaluation: ActivityEvaluation,
    out_dir: str | Path,
    *,
    command: str | None,
    progress: Progress,
) -> Path:
    """Write ``evaluation.html``, ``figures/det.png`` and ``evaluation.json``; returns the page.

    All of them or none (:func:`.staged`). Raises :class:`OutputError` where the folder cannot be
    written.
    """
    from importlib.metadata import version

    from scene4d.evaluation.pages.activities import render_activities
    from scene4d.evaluation.pages.det import draw_det

    out = ensure_folder(out_dir)
    with (
        progress.stage("Drawing the evaluation", None),
        staged(out, ["figures/det.png", "evaluation.html"], last="evaluation.json") as folder,
    ):
        pictures = {"det": draw_det(evaluation)}
        page = render_activities(evaluation, pictures, command=command, version=version("scene4d"))
        (folder / "figures").mkdir()
        for name, content in pictures.items():
            write_bytes(folder / "figures" / f"{name}.png", content)
        write_bytes(folder / "evaluation.html", page.encode())
        write_json(folder / "evaluation.json", evaluation.to_dict())
    return out / "evaluation.html"
