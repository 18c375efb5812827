"""The table of an evaluation: one line per setting, the truth, and what the paper published."""

from dataclasses import dataclass, field

import numpy as np

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.drawing.words import number
from scene4d.evaluation.datasets.reference import Published
from scene4d.evaluation.pages.charts import auc_text, height_text
from scene4d.evaluation.pages.headline import at_height
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome, Setting

_NONE = "–"


@dataclass(frozen=True)
class Cell:
    """One cell. ``label`` names its column where the table is shown as cards, ``note`` is the
    number of a footnote, and ``told`` says that the value was given, not estimated. ``off`` is
    its difference to the truth.
    """

    label: str
    text: str
    title: str = ""
    note: int | None = None
    told: bool = False
    off: str = ""


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
    """Columns after footage, method and given; ``notes`` are the footnotes, from 1."""

    columns: list[str]
    lines: list[Line] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    main_height: str = ""

    def note(self, text: str) -> int:
        """Number of the footnote that says this."""
        text = f"{text[:1].upper()}{text[1:].rstrip('.')}."
        if text not in self.notes:
            self.notes.append(text)
        return self.notes.index(text) + 1


def table(evaluation: Evaluation) -> Table:
    """The lines in the order of the evaluation, then the truth and the published numbers."""
    every = evaluation.heights_m()
    main = min(every, key=lambda h: abs(h - PERSON_HEIGHT_M), default=PERSON_HEIGHT_M)
    columns = [f"{height_text(h)} m" for h in every]
    columns += ["predicted / found, RMS", "AUC", "focal length", "tilt", "height"]
    made = Table(columns, main_height=height_text(main))
    for setting in evaluation.settings():
        made.lines.append(_line(made, evaluation, setting, every, main))
    truth = evaluation.reference.truth
    if isinstance(truth, Camera):
        made.lines.append(_truth(made, evaluation, truth, len(every)))
    if evaluation.published is not None:
        made.lines.append(_published(made, evaluation.published, every))
    return made


def _line(
    made: Table, evaluation: Evaluation, setting: Setting, every: list[float], main: float
) -> Line:
    outcomes = evaluation.of(setting)
    by_height = {outcome.person_height_m: outcome for outcome in outcomes}
    cells = []
    for label, height in zip(made.columns, every, strict=False):
        cells.append(_error(made, f"error (m), people {label}", by_height.get(height)))
    chosen = at_height(outcomes, main)
    if chosen.person_height_m != main or chosen.error is None:
        cells += [Cell(label, _NONE) for label in made.columns[len(every) :]]
    else:
        cells += _at_main_height(evaluation, chosen, made.columns[len(every) :])
    kind = "circular" if setting.circular else ""
    return Line(setting.footage, setting.method, setting.given, cells, kind)


def _error(made: Table, label: str, outcome: Outcome | None) -> Cell:
    if outcome is None:
        return Cell(label, _NONE)
    if outcome.error is None:
        reason = outcome.reason or "no reason was recorded"
        return Cell(label, "refused", reason, made.note(reason))
    return Cell(label, f"{number(outcome.error.mean_m, 2)} ± {number(outcome.error.sd_m, 2)}")


def _at_main_height(evaluation: Evaluation, outcome: Outcome, columns: list[str]) -> list[Cell]:
    found, error = outcome.calibration, outcome.error
    assert found is not None
    assert found.camera is not None
    assert error is not None
    predicted = _NONE
    expected = outcome.predicted_m
    if found.covariance is not None and expected is not None and np.isfinite(expected):
        predicted = number(expected, 2)
    auc = None if outcome.near is None else outcome.near.auc
    cells = [
        Cell(columns[0], f"{predicted}\u00a0/\u00a0{number(error.rms_m, 2)}"),
        Cell(columns[1], _NONE if auc is None else auc_text(auc)),
    ]
    truth = evaluation.reference.truth
    true = truth if isinstance(truth, Camera) else None
    sigma = found.sigma
    for label, name in zip(columns[2:], ("focal_px", "tilt_deg", "height_m"), strict=True):
        text, off = _parameter(name, found.camera, true)
        cells.append(Cell(label, text, told=sigma.get(name) == 0.0, off=off))
    return cells


def _parameter(name: str, camera: Camera, true: Camera | None) -> tuple[str, str]:
    """``("1230 px", "+3.8 %")``: a parameter, and its difference to the truth if there is one."""
    if name == "focal_px":
        off = None if true is None else 100 * (camera.focal_px / true.focal_px - 1)
        return f"{number(camera.focal_px, 0)}\u00a0px", _off(off, 1, "\u00a0%")
    if name == "tilt_deg":
        off = None if true is None else float(np.degrees(camera.tilt_rad - true.tilt_rad))
        return f"{number(float(np.degrees(camera.tilt_rad)), 1)}°", _off(off, 1, "°")
    off = None if true is None else camera.height_m - true.height_m
    return f"{number(camera.height_m, 2)}\u00a0m", _off(off, 2, "\u00a0m")


def _off(value: float | None, places: int, unit: str) -> str:
    if value is None:
        return ""
    text = number(value, places)
    return f"{'+' if value > 0 and float(text) != 0 else ''}{text}{unit}"


def _truth(made: Table, evaluation: Evaluation, truth: Camera, blank: int) -> Line:
    labels = made.columns
    cells = [Cell(label, _NONE) for label in labels[: blank + 2]]
    for label, name in zip(labels[-3:], ("focal_px", "tilt_deg", "height_m"), strict=True):
        cells.append(Cell(label, _parameter(name, truth, None)[0]))
    return Line(f"the true camera of {evaluation.reference.name}", _NONE, _NONE, cells, "truth")


def _published(made: Table, published: Published, every: list[float]) -> Line:
    cells = []
    for label, height in zip(made.columns, every, strict=False):
        here = abs(height - published.person_height_m) < 1e-9
        text = f"{number(published.mean_m, 2)} ± {number(published.sd_m, 2)}" if here else _NONE
        cells.append(Cell(f"error (m), people {label}", text))
    note = made.note(f"Published for a mean height of {height_text(published.auc_height_m)} m.")
    rest = made.columns[len(every) :]
    cells += [Cell(rest[0], _NONE), Cell(rest[1], f"{published.auc:g}", note=note)]
    cells += [Cell(label, _NONE) for label in rest[2:]]
    footage = f"Wagner et al. (2019), {published.frames} frames"
    return Line(footage, "paper", "network", cells, "published")
