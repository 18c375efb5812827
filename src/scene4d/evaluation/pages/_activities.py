"""The page of an evaluation of activity search: what was found, and what limits the figures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from scene4d.drawing.page import as_shown, made_by, rendered, seconds_text
from scene4d.drawing.style import Drawn
from scene4d.drawing.words import number
from scene4d.evaluation.measures._events import NIST, RULES
from scene4d.evaluation.pages._table import Cell
from scene4d.evaluation.trials.activities import FALSE_PER_MINUTE, ActivityEvaluation, Trust
from scene4d.searching.activities.search import MIN_SCORE


@dataclass(frozen=True)
class ActivityLine:
    """One activity, its names in the data set, and how often it is labelled."""

    activity: str
    names: str
    labelled: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Sheet:
    """A table: groups of columns with a heading each, and a line per activity, the last the mean
    of all.
    """

    heading: str
    caption: str
    groups: tuple[tuple[str, tuple[str, ...]], ...]
    lines: tuple[ActivityLine, ...]


_Column = Callable[[str], float | None]
"""The value of an activity."""


def sheets(evaluation: ActivityEvaluation) -> list[Sheet]:
    """All tables: by method, by rule and camera, and of the probabilities."""
    return [_by_method(evaluation), _by_rule(evaluation), _trust(evaluation)]


def _by_method(evaluation: ActivityEvaluation) -> Sheet:
    names = tuple(method.name for method in evaluation.methods)
    ours = evaluation.ours
    columns: list[_Column] = [
        lambda one, name=name: evaluation.of(name, one).average_precision  # type: ignore[misc]
        for name in names
    ]
    columns += [
        lambda one, rate=rate: ours(one).missed_at(rate)  # type: ignore[misc]
        for rate in FALSE_PER_MINUTE
    ]
    caption = " ".join(f"{method.name}: {method.description}." for method in evaluation.methods)
    groups = (
        ("average precision", names),
        (
            f"{names[0]}: missed at false alarms a minute",
            tuple(f"{rate:g}" for rate in FALSE_PER_MINUTE),
        ),
    )
    note = " The best average precision is bold. A dash: the method cannot look for this."
    return _sheet(evaluation, "Every activity", caption + note, groups, columns, best=len(names))


def _by_rule(evaluation: ActivityEvaluation) -> Sheet:
    ours = evaluation.ours

    def column(rule: str, camera: str | None = None) -> _Column:
        return lambda one: ours(one).precision_by(rule, camera)

    cameras = evaluation.reported if len(evaluation.reported) > 1 else ()
    columns = [column(rule, camera) for camera in (None, *cameras) for rule in RULES]
    ranges = {number: rule for number, rule in enumerate(RULES) if rule in (NIST, "IoU 0.5")}
    caption = (
        f"Average precision of {evaluation.methods[0].name}. 1 s: NIST's rule; IoU: at least so "
        "much of the time of both is common to both; participants: NIST's rule, and all who take "
        "part are actors of the label. In brackets, 95 % over clips drawn with replacement."
    )
    groups = tuple((name, tuple(RULES)) for name in ("all cameras", *cameras))
    heading = "How exactly, and on which camera"
    return _sheet(evaluation, heading, caption, groups, columns, ranges=ranges)


def _trust(evaluation: ActivityEvaluation) -> Sheet:
    def column(value: Callable[[Trust], float]) -> _Column:
        def of(one: str) -> float | None:
            trust = evaluation.ours(one).trust
            return None if trust is None else value(trust)

        return of

    columns: dict[str, Callable[[Trust], float]] = {
        "stated": lambda t: t.stated,
        "right": lambda t: t.right,
        "error, raw": lambda t: t.expected_error,
        "true ones: mean": lambda t: t.without_chance.floor,
        "95 % below": lambda t: t.without_chance.chance,
        "debiased": lambda t: t.without_chance.debiased,
        "from": lambda t: t.without_chance.low,
        "to": lambda t: t.without_chance.high,
    }
    caption = (
        f"Events with a score of {MIN_SCORE:g} or more, which a search shows by default: mean of "
        "the stated probability, share that was right, and expected calibration error (the mean "
        "distance of the two in ten bins), raw: as counted. Events are few, so that true "
        "probabilities would err as well, by so much in the mean, and by less than the next in "
        "95 % of cases. Debiased: the error without what chance adds, and from where to where 95 % "
        "of it lies. Probabilities were fitted on cameras "
        f"{' and '.join(evaluation.tuned)}. A dash: too few labels there, or "
        "scores that say no more than the share of right events."
    )
    return _sheet(
        evaluation,
        "Are the probabilities true",
        caption,
        (("probability", tuple(columns)),),
        [column(value) for value in columns.values()],
    )


def _sheet(
    evaluation: ActivityEvaluation,
    heading: str,
    caption: str,
    groups: tuple[tuple[str, tuple[str, ...]], ...],
    columns: Sequence[_Column],
    *,
    best: int = 0,
    ranges: Mapping[int, str] = MappingProxyType({}),
) -> Sheet:
    """A table of columns; the highest of the first ``best`` ones is marked, and columns of rules
    that have ``ranges`` show them.
    """
    labels = [f"{group}, {name}" for group, names in groups for name in names]
    shown = [name for name, count in evaluation.labels.items() if count]
    values = {name: [column(name) for column in columns] for name in shown}
    lines = []
    for name in shown:
        spans = {number: evaluation.ours(name).interval(rule) for number, rule in ranges.items()}
        also = ", ".join(n for n in evaluation.activities[name] if n != name)
        cells = _cells(labels, values[name], best, spans)
        count = str(evaluation.labels[name])
        lines.append(ActivityLine(name.replace("_", " "), also, count, cells))
    means: list[float | None] = []
    for column in zip(*values.values(), strict=True):
        known = [value for value in column if value is not None]
        means.append(sum(known) / len(known) if known else None)
    # Methods that search for fewer activities have a mean of others: none is the best.
    lines.append(ActivityLine("mean", "", "", _cells(labels, means or [None] * len(labels), 0)))
    return Sheet(heading, caption, groups, tuple(lines))


def _cells(
    labels: Sequence[str],
    values: Sequence[float | None],
    best: int,
    spans: Mapping[int, tuple[float, float] | None] = MappingProxyType({}),
) -> tuple[Cell, ...]:
    compared = [value for value in values[:best] if value is not None]
    top = max(compared) if len(set(compared)) > 1 else None
    cells = []
    for place, (label, value) in enumerate(zip(labels, values, strict=True)):
        if value is None:
            cells.append(Cell(label))
            continue
        text = number(value, 2)
        if span := spans.get(place):
            text += f" [{number(span[0], 2)}, {number(span[1], 2)}]"
        cells.append(Cell(label, text, best=place < best and value == top))
    return tuple(cells)


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
    rates = " and ".join(f"{rate:g}" for rate in sorted(FALSE_PER_MINUTE))
    alt = "DET curves of every activity, one panel each, for all methods."
    caption = (
        "Share of the labelled events that is missed, over false alarms per minute of footage "
        "(logarithmic), as the threshold falls; the number of labels is in brackets. Broken "
        f"vertical lines: {rates} a minute. Where a curve stays level at its end nothing more was "
        "found."
    )
    values: dict[str, Any] = {
        "title": f"{evaluation.name.upper()}: activities on cameras "
        f"{' and '.join(evaluation.reported)}",
        "verdict": verdict(evaluation),
        "sheets": sheets(evaluation),
        "notes": evaluation.notes,
        "figures": as_shown(pictures, lambda _: alt, lambda _: caption),
        "provenance": [
            ("Data set", evaluation.name),
            ("Cameras reported", ", ".join(evaluation.reported)),
            ("Cameras tuned on", ", ".join(evaluation.tuned)),
            ("Clips", f"{evaluation.clips}, {number(evaluation.minutes, 0)} minutes"),
            *made_by(command),
        ],
        "timings": [(name, seconds_text(s)) for name, s in evaluation.timings.items()],
    }
    return rendered("scene4d.evaluation.pages", "activities.html.j2", values)
