"""DET curves: what a search misses at which rate of false alarms, one panel per activity."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, PercentFormatter

from scene4d.drawing import style
from scene4d.evaluation.activity_evaluation import FALSE_PER_MINUTE, ActivityEvaluation
from scene4d.evaluation.activity_scores import DetCurve
from scene4d.evaluation.pages import look

# Okabe and Ito (2008); the lines differ as well, the first one is ours.
_LOOKS = (
    ("#0072B2", "solid", 2.2),
    ("#D55E00", (0, (4, 1.6)), 1.5),
    ("#4D4D4D", (0, (1, 1.4)), 1.6),
)
COLUMNS = 3
LEAST, MOST = 0.002, 2.0
"""False alarms per minute at the ends of the axis."""
_PANEL_IN, _STRIP_IN, _TOP_IN, _BETWEEN_IN, _LEFT_IN = 1.45, 1.05, 0.35, 0.55, 0.72


def draw_det(evaluation: ActivityEvaluation) -> bytes:
    """PNG of the DET curves of every activity that is labelled, in the order of the table."""
    shown = [name for name in evaluation.activities if evaluation.labels[name]]
    rows = max(1, -(-len(shown) // COLUMNS))
    height = _STRIP_IN + _TOP_IN + rows * _PANEL_IN + (rows - 1) * _BETWEEN_IN
    fig = style.figure(look.WIDTH_IN, height)
    wide = (1 - (_LEFT_IN + 0.1) / look.WIDTH_IN - (COLUMNS - 1) * 0.035) / COLUMNS
    for number, name in enumerate(shown):
        row, column = divmod(number, COLUMNS)
        below = height - _TOP_IN - _PANEL_IN - row * (_PANEL_IN + _BETWEEN_IN)
        left = _LEFT_IN / look.WIDTH_IN + column * (wide + 0.035)
        axes = fig.add_axes((left, below / height, wide, _PANEL_IN / height))
        _panel(axes, evaluation, name)
        lowest = number + COLUMNS >= len(shown)
        look.quiet(
            axes,
            "false alarms per minute" if lowest else "",
            "missed" if column == 0 else "",
        )
        axes.tick_params(labelleft=column == 0, labelbottom=lowest)
    handles = [
        Line2D([], [], color=colour, ls=dashes, lw=width, label=method.name)
        for method, (colour, dashes, width) in zip(evaluation.methods, _LOOKS, strict=False)
    ]
    style.legend_below(fig, handles, 0.3, columns=len(handles), size=look.TEXT)
    return style.png(fig)


def _panel(axes: Axes, evaluation: ActivityEvaluation, activity: str) -> None:
    for rate in FALSE_PER_MINUTE:
        axes.axvline(rate, color=style.FAINT, lw=0.8, ls=(0, (3, 3)), zorder=1)
    drawn = list(zip(evaluation.methods, _LOOKS, strict=False))
    for method, (colour, dashes, width) in reversed(drawn):
        curve = evaluation.of(method.name, activity).det
        if curve is not None:
            x, y = outline(curve)
            axes.plot(x, y, color=colour, ls=dashes, lw=width, zorder=3)
    axes.set_xscale("log")
    axes.set_xlim(LEAST, MOST)
    axes.set_xticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(-0.02, 1.02)
    axes.set_yticks([0, 0.5, 1])
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, 0))
    axes.set_title(
        f"{activity.replace('_', ' ')} ({evaluation.labels[activity]})",
        loc="left",
        fontsize=look.SMALL,
        color=style.INK,
        pad=3,
    )


def outline(curve: DetCurve) -> tuple[np.ndarray, np.ndarray]:
    """The curve over the whole axis: everything is missed left of its first point, and right of
    its last one nothing more is found. What lies left of the axis is left out, but for the point
    that it begins with.
    """
    x, y = curve.false_per_minute, curve.missed
    before = int(np.searchsorted(x, LEAST, side="right"))
    points = [(LEAST, y[before - 1] if before else 1.0)]
    if not before and len(x):
        points.append((x[0], 1.0))
    points += zip(x[before:], y[before:], strict=True)
    points.append((max(MOST, points[-1][0]), points[-1][1]))
    right, up = np.array(points, float).T
    return right, up
