"""The table of an evaluation: one line per setting, the truth, and what the paper published."""

from dataclasses import dataclass, field

import numpy as np

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.drawing.words import number
from scene4d.evaluation.datasets._reference import Published
from scene4d.evaluation.pages._charts import auc_text, height_text
from scene4d.evaluation.pages._headline import at_height
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome, Setting

_NONE = "–"
_CAMERA = ("focal length", "tilt", "height")


@dataclass(frozen=True)
class Cell:
    """One cell. ``label`` names its column where the table is shown as cards, ``note`` is the
    number of a footnote, ``told`` says that the value was given, not estimated, ``off`` is its
    difference from the truth, and ``best`` marks the best of its kind in the line.
    """

    label: str
    text: str = _NONE
    title: str = ""
    note: int | None = None
    told: bool = False
    off: str = ""
    best: bool = False


@dataclass(frozen=True)
class Line:
    """One line of the table; ``kind`` is "", "circular", "truth" or "published"."""

    footage: str
    method: str
    given: str
    cells: list[Cell]
    kind: str = ""


@dataclass
class Table:
    """The lines, for these mean heights of people; ``notes`` are the footnotes, from 1."""

    heights_m: list[float]
    lines: list[Line] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def main_height_m(self) -> float:
        """The height that the columns on the right are about: the default, or the nearest one."""
        return min(self.heights_m, key=lambda h: abs(h - PERSON_HEIGHT_M), default=PERSON_HEIGHT_M)

    @property
    def main_height(self) -> str:
        """The same as text."""
        return height_text(self.main_height_m)

    @property
    def columns(self) -> list[str]:
        """Headings after footage, method and given."""
        heights = [f"{height_text(h)} m" for h in self.heights_m]
        return [*heights, "predicted / found, RMS", "AUC", *_CAMERA]

    def note(self, text: str) -> int:
        """Number of the footnote that says this."""
        text = f"{text[:1].upper()}{text[1:].rstrip('.')}."
        if text not in self.notes:
            self.notes.append(text)
        return self.notes.index(text) + 1


def table(evaluation: Evaluation) -> Table:
    """The lines in the order of the evaluation, then the truth and the published numbers."""
    made = Table(evaluation.heights_m())
    truth = evaluation.reference.truth
    true = truth if isinstance(truth, Camera) else None
    for setting in evaluation.settings():
        made.lines.append(_line(made, setting, evaluation.of(setting), true))
    if true is not None:
        made.lines.append(_truth(made, f"the true camera of {evaluation.reference.name}", true))
    if evaluation.published is not None:
        made.lines.append(_published(made, evaluation.published))
    return made


def _line(made: Table, setting: Setting, outcomes: list[Outcome], true: Camera | None) -> Line:
    by_height = {outcome.person_height_m: outcome for outcome in outcomes}
    cells = [_error(made, height, by_height.get(height)) for height in made.heights_m]
    cells += _at_main_height(made, at_height(outcomes, made.main_height_m), true)
    kind = "circular" if setting.circular else ""
    return Line(setting.footage, setting.method, setting.given, cells, kind)


def _error_label(height_m: float) -> str:
    return f"error (m), people {height_text(height_m)} m"


def _error(made: Table, height_m: float, outcome: Outcome | None) -> Cell:
    label = _error_label(height_m)
    if outcome is None:
        return Cell(label)
    if outcome.score is None:
        reason = outcome.reason or "no reason was recorded"
        return Cell(label, "refused", reason, made.note(reason))
    error = outcome.score.error
    return Cell(label, f"{number(error.mean_m, 2)} ± {number(error.sd_m, 2)}")


def _at_main_height(made: Table, outcome: Outcome, true: Camera | None) -> list[Cell]:
    rms, auc, *of_camera = made.columns[len(made.heights_m) :]
    score, found = outcome.score, outcome.calibration
    if outcome.person_height_m != made.main_height_m or score is None or found is None:
        return [Cell(label) for label in (rms, auc, *of_camera)]
    predicted = _NONE
    if score.predicted_m is not None and np.isfinite(score.predicted_m):
        predicted = number(score.predicted_m, 2)
    told = [found.sigma.get(name) == 0.0 for name in ("focal_px", "tilt_deg", "height_m")]
    values = zip(of_camera, _parameters(score.camera, true), told, strict=True)
    return [
        Cell(rms, f"{predicted}\u00a0/\u00a0{number(score.error.rms_m, 2)}"),
        Cell(auc, _NONE if score.near.auc is None else auc_text(score.near.auc)),
        *(Cell(label, text, told=given, off=off) for label, (text, off), given in values),
    ]


def _parameters(camera: Camera, true: Camera | None) -> list[tuple[str, str]]:
    """``("1230 px", "+3.8 %")``: focal length, tilt and height, and their differences from the
    truth if there is one.
    """
    tilt_deg = float(np.degrees(camera.tilt_rad))
    texts = (
        f"{number(camera.focal_px, 0)}\u00a0px",
        f"{number(tilt_deg, 1)}°",
        f"{number(camera.height_m, 2)}\u00a0m",
    )
    if true is None:
        return [(text, "") for text in texts]
    differences = (
        _signed(100 * (camera.focal_px / true.focal_px - 1), 1, "\u00a0%"),
        _signed(tilt_deg - float(np.degrees(true.tilt_rad)), 1, "°"),
        _signed(camera.height_m - true.height_m, 2, "\u00a0m"),
    )
    return list(zip(texts, differences, strict=True))


def _signed(value: float, places: int, unit: str) -> str:
    text = number(value, places)
    return f"{'+' if value > 0 and float(text) != 0 else ''}{text}{unit}"


def _truth(made: Table, name: str, true: Camera) -> Line:
    blank = [Cell(label) for label in made.columns[: -len(_CAMERA)]]
    texts = zip(_CAMERA, _parameters(true, None), strict=True)
    return Line(name, _NONE, _NONE, [*blank, *(Cell(n, t) for n, (t, _) in texts)], "truth")


def _published(made: Table, published: Published) -> Line:
    cells = [Cell(_error_label(height)) for height in made.heights_m]
    if published.person_height_m in made.heights_m:
        text = f"{number(published.mean_m, 2)} ± {number(published.sd_m, 2)}"
        at = made.heights_m.index(published.person_height_m)
        cells[at] = Cell(_error_label(published.person_height_m), text)
    note = made.note(f"Published for a mean height of {height_text(published.auc_height_m)} m.")
    rms, auc, *rest = made.columns[len(made.heights_m) :]
    cells += [Cell(rms), Cell(auc, f"{published.auc:g}", note=note), *map(Cell, rest)]
    footage = f"Wagner et al. (2019), {published.frames} frames"
    return Line(footage, "paper", "network", cells, "published")
