"""The short account of an evaluation of activity search."""

from pathlib import Path

from rich.table import Table

from scene4d.cli.output import screen
from scene4d.evaluation.activity_evaluation import FALSE_PER_MINUTE, ActivityEvaluation


def show_activities(found: ActivityEvaluation, out: Path | None) -> None:
    """Average precision and misses by activity and method, and what must be said beside it."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("Activity", no_wrap=True)
    table.add_column("Labels", justify="right")
    for name in ("AP", *(f"@{rate:g}" for rate in FALSE_PER_MINUTE)):
        for method in found.methods:
            table.add_column(f"{name}\n{method.name}", justify="right", no_wrap=True)
    for activity in found.activities:
        if not found.labels[activity]:
            continue
        outcomes = [found.of(method.name, activity) for method in found.methods]
        cells = [_number(one.average_precision) for one in outcomes]
        for rate in FALSE_PER_MINUTE:
            cells += [_number(one.missed_at(rate)) for one in outcomes]
        table.add_row(activity, str(found.labels[activity]), *cells)
    means = [found.mean_average_precision(method.name) for method in found.methods]
    blank = [""] * (len(found.methods) * len(FALSE_PER_MINUTE))
    table.add_row("mean", "", *map(_number, means), *blank, style="bold")
    with screen() as console:
        console.print(
            f"{found.name}: {found.clips} clips, {found.minutes:g} minutes, cameras "
            f"{' and '.join(found.reported)}; constants chosen on {' and '.join(found.tuned)}. "
            "AP: average precision. @r: share missed at r false alarms per minute."
        )
        console.print()
        console.print(table)
        for method in found.methods:
            console.print(f"\n{method.name}: {method.description}.", style="dim")
        for note in found.notes:
            console.print(f"\n{note}", style="dim")
        if out is not None:
            console.print(f"\nReport   {out / 'evaluation.html'}", soft_wrap=True)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
