"""The printed summary of an evaluation, of cameras or of activities."""

from pathlib import Path

from rich.table import Table

from scene4d.cli.output import screen
from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.evaluation.pages.site import COLUMNS, site_facts, site_lines, site_verdict
from scene4d.evaluation.trials.activities import FALSE_PER_MINUTE, ActivityEvaluation, Trust
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome, Setting
from scene4d.evaluation.trials.sites import SiteEvaluation

_CIRCULAR = "circular"


def show(found: Evaluation | ActivityEvaluation | SiteEvaluation, out: Path | None) -> None:
    """Print the table, the notes and the path of the page."""
    if isinstance(found, Evaluation):
        _show_cameras(found, out)
    elif isinstance(found, SiteEvaluation):
        _show_site(found, out)
    else:
        _show_activities(found, out)


def _show_site(found: SiteEvaluation, out: Path | None) -> None:
    """Print errors by pair of cameras, and what else was measured."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for name in COLUMNS:
        table.add_column(name, no_wrap=True)
    for line in site_lines(found):
        table.add_row(*line)
    with screen() as console:
        console.print(site_verdict(found))
        console.print()
        if found.pairs:
            console.print(table)
        for fact in site_facts(found):
            console.print(f"\n{fact}", style="dim")
        if out is not None:
            console.print(f"\nReport   {out / 'evaluation.html'}", soft_wrap=True)


def _show_cameras(found: Evaluation, out: Path | None) -> None:
    """Print errors by setting and mean height, the paper's errors, and what was left out."""
    heights = sorted({outcome.person_height_m for outcome in found.outcomes})
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("Method and what it is given")
    for heading in (*(f"{height:g} m" for height in heights), "Predicted", "AUC"):
        table.add_column(heading, justify="right", no_wrap=True)
    footage = None
    for setting in found.settings():
        style = "dim" if setting.circular else None
        if setting.footage != footage:
            footage = setting.footage
            name = f"{footage} ({_CIRCULAR})" if setting.circular else footage
            table.add_row(name, style=style or "bold")
        table.add_row(*_row(setting, found.of(setting), heights), style=style)
    _published(table, found, heights)
    with screen() as console:
        console.print(
            f"{found.reference.name}: mean ± standard deviation of the correspondence error in "
            f"metres over {len(found.reference.points_uv)} points, by the mean height of people. "
            f"Predicted (root mean square, by the calibration itself) and AUC of P(near) at "
            f"{PERSON_HEIGHT_M:g} m."
        )
        console.print()
        console.print(table)
        for note in (*_reasons(found), *found.notes):
            console.print(f"\n{note}", style="dim")
        if out is not None:
            console.print(f"\nReport   {out / 'evaluation.html'}", soft_wrap=True)


def _row(setting: Setting, outcomes: list[Outcome], heights: list[float]) -> list[str]:
    by_height = {outcome.person_height_m: outcome for outcome in outcomes}
    cells = [_error(by_height.get(height)) for height in heights]
    middle = by_height.get(PERSON_HEIGHT_M, outcomes[0])
    score = middle.score
    auc = "" if score is None else _number(score.near.auc, 4)
    predicted = "" if score is None else _number(score.predicted_m, 2)
    given = f", given {setting.given}" if setting.given else ""
    return [f"  {setting.method}{given}", *cells, predicted, auc]


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _error(outcome: Outcome | None) -> str:
    if outcome is None:
        return ""
    if outcome.score is None:
        return "refused"
    return f"{outcome.score.error.mean_m:.2f}±{outcome.score.error.sd_m:.2f}"


def _published(table: Table, found: Evaluation, heights: list[float]) -> None:
    p = found.published
    if p is None:
        return
    text = f"{p.mean_m:.2f}±{p.sd_m:.2f}"
    cells = [text if height == p.person_height_m else "" for height in heights]
    table.add_row(f"published, {p.frames} frames", style="bold")
    table.add_row("  paper, given by its network", *cells, "", f"{p.auc:.2f}", style="bold")


def _reasons(found: Evaluation) -> list[str]:
    """Each reason for a missing result, once."""
    reasons: dict[str, list[str]] = {}
    for outcome in found.outcomes:
        if outcome.score is None and outcome.reason is not None:
            name = f"{outcome.setting.footage}, {outcome.setting.method}"
            named = reasons.setdefault(outcome.reason, [])
            if name not in named:
                named.append(name)
    return [f"Refused ({'; '.join(names)}): {why}." for why, names in reasons.items()]


def _show_activities(found: ActivityEvaluation, out: Path | None) -> None:
    """Print average precision and misses by activity and method, with the notes."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("Activity", no_wrap=True)
    table.add_column("Labels", justify="right", no_wrap=True)
    for method in found.methods:
        table.add_column(f"AP\n{method.name}", justify="right", no_wrap=True)
    first = found.methods[0].name
    more = (*(f"@{rate:g}" for rate in FALSE_PER_MINUTE), "IoU 0.5", "error of P")
    for name in more:
        table.add_column(f"{name}\n{first}", justify="right", no_wrap=True)
    for activity in found.activities:
        if not found.labels[activity]:
            continue
        outcomes = [found.of(method.name, activity) for method in found.methods]
        cells = [_precision(one.average_precision) for one in outcomes]
        ours, trust = outcomes[0], outcomes[0].trust
        cells += [_precision(ours.missed_at(rate)) for rate in FALSE_PER_MINUTE]
        cells.append(_precision(ours.precision_by("IoU 0.5")))
        cells.append("–" if trust is None else _errors(trust))
        table.add_row(activity, str(found.labels[activity]), *cells)
    means = [found.mean_average_precision(method.name) for method in found.methods]
    table.add_row("mean", "", *map(_precision, means), *[""] * len(more), style="bold")
    with screen() as console:
        console.print(
            f"{found.name}: {found.clips} clips, {found.minutes:g} minutes, cameras "
            f"{' and '.join(found.reported)}; constants chosen on {' and '.join(found.tuned)}. "
            "AP: average precision. @r: share missed at r false alarms per minute. IoU 0.5: AP "
            "where half of the time must be common. Error of P: expected calibration error of the "
            "stated probabilities, raw, and in brackets debiased: 95 % of what is left without "
            "chance."
        )
        console.print()
        console.print(table)
        for method in found.methods:
            console.print(f"\n{method.name}: {method.description}.", style="dim")
        for note in found.notes:
            console.print(f"\n{note}", style="dim")
        if out is not None:
            console.print(f"\nReport   {out / 'evaluation.html'}", soft_wrap=True)


def _errors(trust: Trust) -> str:
    without = trust.without_chance
    return f"{trust.expected_error:.3f} ({without.low:.2f}-{without.high:.2f})"


def _precision(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
