"""The page of an evaluation of activity search: what was found, and what limits the figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scene4d.drawing.page import Shown, data_uri, rendered, seconds_text
from scene4d.drawing.style import Drawn
from scene4d.drawing.words import number
from scene4d.evaluation.pages._table import Cell
from scene4d.evaluation.trials.activities import FALSE_PER_MINUTE, ActivityEvaluation


@dataclass(frozen=True)
class ActivityLine:
    """One activity; the cells go by measure, and within it by method."""

    activity: str
    names: str
    labelled: str
    cells: tuple[Cell, ...]


def measures() -> tuple[str, ...]:
    """Headings of the groups of columns."""
    return (
        "average precision",
        *(f"missed at {rate:g} false alarms a minute" for rate in FALSE_PER_MINUTE),
    )


def lines(evaluation: ActivityEvaluation) -> list[ActivityLine]:
    """The table: activities that are labelled, then the mean."""
    made = []
    for name, names in evaluation.activities.items():
        if not evaluation.labels[name]:
            continue
        outcomes = [evaluation.of(method.name, name) for method in evaluation.methods]
        groups = [[outcome.average_precision for outcome in outcomes]]
        groups += [[outcome.missed_at(rate) for outcome in outcomes] for rate in FALSE_PER_MINUTE]
        known = ", ".join(n for n in names if n != name)
        cells = _cells(evaluation, groups)
        made.append(
            ActivityLine(name.replace("_", " "), known, str(evaluation.labels[name]), cells)
        )
    means = [[evaluation.mean_average_precision(method.name) for method in evaluation.methods]]
    made.append(ActivityLine("mean", "", "", _cells(evaluation, means)))
    return made


def _cells(evaluation: ActivityEvaluation, groups: list[list[float | None]]) -> tuple[Cell, ...]:
    cells = []
    for k, measure in enumerate(measures()):
        values = groups[k] if k < len(groups) else [None] * len(evaluation.methods)
        known = [value for value in values if value is not None]
        best = (max(known) if k == 0 else min(known)) if len(set(known)) > 1 else None
        for method, value in zip(evaluation.methods, values, strict=True):
            label = f"{measure}, {method.name}"
            cells.append(_cell(label, value, best))
    return tuple(cells)


def _cell(label: str, value: float | None, best: float | None) -> Cell:
    return Cell(label) if value is None else Cell(label, number(value, 2), best=value == best)


def verdict(evaluation: ActivityEvaluation) -> str:
    """How ours compares with the baselines, in one sentence."""
    ours, *others = evaluation.methods
    mean = evaluation.mean_average_precision(ours.name)
    if mean is None:
        return "Nothing is labelled that the catalogue knows."
    everything = len(evaluation.searched(ours.name))
    parts = [f"Mean average precision {number(mean, 2)} over {everything} activities"]
    for method in others:
        mean = evaluation.mean_average_precision(method.name)
        count = len(evaluation.searched(method.name))
        if mean is not None:
            of = "" if count == everything else f" over the {count} that it can search for"
            parts.append(f"{number(mean, 2)} by {method.name}{of}")
    return f"{'; '.join(parts)}."


def render_activities(
    evaluation: ActivityEvaluation, pictures: Mapping[str, Drawn], *, command: str | None
) -> str:
    """The page as HTML, with the ``pictures`` (``det``) inside it."""
    figures = {
        name: Shown(
            name,
            data_uri(picture.page_png),
            "DET curves of every activity, one panel each, for all methods.",
            "Share of the labelled events that is missed, over false alarms per minute of footage "
            "(logarithmic), as the threshold falls; the number of labels is in brackets. Broken "
            "vertical lines: "
            + " and ".join(f"{rate:g}" for rate in sorted(FALSE_PER_MINUTE))
            + " a minute. Where a curve stays level at its end nothing more was found.",
            picture.legend,
        )
        for name, picture in pictures.items()
    }
    values: dict[str, Any] = {
        "title": f"{evaluation.name.upper()}: activities on cameras "
        f"{' and '.join(evaluation.reported)}",
        "verdict": verdict(evaluation),
        "methods": evaluation.methods,
        "measures": measures(),
        "lines": lines(evaluation),
        "notes": evaluation.notes,
        "figures": figures,
        "provenance": _provenance(evaluation, command),
        "timings": [(name, seconds_text(s)) for name, s in evaluation.timings.items()],
    }
    return rendered("scene4d.evaluation.pages", "activities.html.j2", values)


def _provenance(evaluation: ActivityEvaluation, command: str | None) -> list[tuple[str, str]]:
    from importlib.metadata import version

    rows = [
        ("Data set", evaluation.name),
        ("Cameras reported", ", ".join(evaluation.reported)),
        ("Cameras tuned on", ", ".join(evaluation.tuned)),
        ("Clips", f"{evaluation.clips}, {number(evaluation.minutes, 0)} minutes"),
        ("scene4d", version("scene4d")),
    ]
    return rows if command is None else [*rows, ("Command", command)]
