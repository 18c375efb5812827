"""The files of an evaluation."""

from pathlib import Path

from scene4d.core.files import write_bytes, write_json
from scene4d.core.progress import Progress
from scene4d.core.staging import ensure_folder, staged
from scene4d.evaluation import Evaluation


def write_evaluation(
    evaluation: Evaluation, out_dir: str | Path, *, command: str | None, progress: Progress
) -> Path:
    """Write ``evaluation.html``, ``figures/*.png`` and ``evaluation.json``; returns the page.

    All of them or none (:func:`.staged`). Raises :class:`OutputError` where the folder cannot be
    written.
    """
    from importlib.metadata import version

    from scene4d.evaluation.pages import FIGURES, draw_evaluation, render_evaluation

    out = ensure_folder(out_dir)
    names = [*(f"figures/{name}.png" for name in FIGURES), "evaluation.html"]
    with (
        progress.stage("Drawing the evaluation", None),
        staged(out, names, last="evaluation.json") as folder,
    ):
        pictures = draw_evaluation(evaluation)
        page = render_evaluation(
            evaluation, pictures, command=command, version=version("scene4d"), timings={}
        )
        (folder / "figures").mkdir()
        for name, content in pictures.items():
            write_bytes(folder / "figures" / f"{name}.png", content)
        write_bytes(folder / "evaluation.html", page.encode())
        write_json(folder / "evaluation.json", evaluation.to_dict())
    return out / "evaluation.html"
