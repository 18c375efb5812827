"""Charts of an evaluation: the paper's figures of P(near) and its ROC, and DET curves."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, PercentFormatter

from scene4d.drawing import style
from scene4d.evaluation.measures._events import DetCurve
from scene4d.evaluation.measures._near import NearPairs
from scene4d.evaluation.measures._probability import Roc, roc_curve
from scene4d.evaluation.pages._headline import Headline
from scene4d.evaluation.trials.activities import FALSE_PER_MINUTE, ActivityEvaluation
from scene4d.evaluation.trials.outcomes import PAPER_HEIGHTS_M, Evaluation
from scene4d.searching.predicates import NEAR_SIGMA_M, near_probability

WIDTH_IN = 5.4
TEXT, SMALL = 10.5, 9.5
"""Points. With :data:`WIDTH_IN`, letters are at least 9 pixels where a page is 400 wide."""
_BIN_M, _MIN_PAIRS = 0.1, 20
"""Bins of the estimated distance, and pairs below which a share is too noisy to draw (its standard
deviation is up to 0.11 at 20). Chosen by hand."""
_REACH_M = 2.25
"""The curve of P(near) is drawn from 0 to so many times τ."""
_LEAST_FALSE = 1e-3
"""Left end of the ROC's axis, which is logarithmic: all that differs happens near zero."""
_MARKERS = ("v", "o", "^")
"""Of the ROC curves, from small to tall people: down, middle, up."""

# Okabe and Ito (2008); the lines differ as well, the first one is ours.
_METHODS = (
    ("#0072B2", "solid", 2.2),
    ("#D55E00", (0, (4, 1.6)), 1.5),
    ("#009E73", (0, (6, 1.4, 1, 1.4)), 1.5),
    (style.AXIS, (0, (1, 1.4)), 1.6),
    ("#CC79A7", (0, (2, 2)), 1.3),
)
_COLUMNS = 2
LEAST, MOST = 0.002, 2.0
"""False alarms per minute at the ends of the DET axis."""
_PANEL_IN, _STRIP_IN, _TOP_IN, _BETWEEN_IN, _LEFT_IN, _GAP_IN = 1.45, 1.05, 0.35, 0.55, 0.72, 0.25


def height_text(height_m: float) -> str:
    """``1.70`` and ``1.7018``: as given, with two digits at least."""
    return f"{height_m:.2f}" if round(height_m, 2) == height_m else f"{height_m:.4f}".rstrip("0")


def quiet(
    axes: Axes, x_label: str = "", y_label: str = "", *, grid: Literal["both", "x", "y"] = "both"
) -> None:
    """Labels, thin grid, no box, no background: a page may be dark."""
    axes.set_xlabel(x_label, fontsize=TEXT, color=style.AXIS)
    axes.set_ylabel(y_label, fontsize=TEXT, color=style.AXIS)
    axes.tick_params(labelsize=SMALL, colors=style.AXIS, length=3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(style.FAINT)
    axes.grid(axis=grid, color=style.AXIS, alpha=0.25, lw=0.7)
    axes.patch.set_alpha(0.0)
    axes.set_axisbelow(True)


@dataclass(frozen=True, eq=False)
class Share:
    """Mean estimated distance (m) of the pairs in a bin, and the share that is truly near."""

    distance_m: Float[np.ndarray, "k"]
    share: Float[np.ndarray, "k"]
    count: Int[np.ndarray, "k"]

    def falls_below(self, level: float) -> float | None:
        """Distance (m) at which the share first falls below ``level``; None where it never does."""
        below = np.flatnonzero(self.share < level)
        if len(below) == 0 or below[0] == 0:
            return None
        k = int(below[0])
        (d0, d1), (s0, s1) = self.distance_m[k - 1 : k + 1], self.share[k - 1 : k + 1]
        return float(d0 + (s0 - level) / (s0 - s1) * (d1 - d0))


def near_share(pairs: NearPairs) -> Share:
    """How often pairs at an estimated distance are truly near, in bins of :data:`_BIN_M` that hold
    at least :data:`_MIN_PAIRS`.
    """
    inside = pairs.estimated_m < _REACH_M * pairs.tau_m
    distance, near = pairs.estimated_m[inside], pairs.positive[inside]
    index = (distance / _BIN_M).astype(int)
    count = np.bincount(index)
    held = count >= _MIN_PAIRS
    total = np.maximum(count, 1)
    mean, share = np.bincount(index, distance) / total, np.bincount(index, near) / total
    return Share(mean[held], share[held], count[held])


def draw_near(shown: tuple[Headline, ...]) -> style.Drawn:
    """P(near) over distance, with what was truly near at each estimated distance."""
    tau = shown[0].score.near.tau_m
    fig, axes = _one_panel()
    d = np.linspace(0, _REACH_M * tau, 400)
    axes.plot(d, near_probability(d, tau_m=tau), color=style.AXIS, lw=2.2)
    axes.plot([0, tau, tau, d[-1]], [1, 1, 0, 0], color=style.FAINT, lw=1.2, ls=(0, (4, 3)))
    handles = [
        Line2D([], [], color=style.AXIS, lw=2.2, label=f"P(near), σ = {NEAR_SIGMA_M:g} m"),
        Line2D([], [], color=style.FAINT, lw=1.2, ls=(0, (4, 3)), label="exact distances"),
    ]
    for s in shown:
        found = near_share(s.score.near)
        mark: dict[str, Any] = {"color": s.colour, "marker": s.marker, "mec": "white", "mew": 0.5}
        axes.plot(found.distance_m, found.share, color=s.colour, lw=1.5, zorder=4)
        turn = _turning(found.share)
        x, y = found.distance_m[turn], found.share[turn]
        axes.plot(x, y, ls="", ms=6.5, clip_on=False, zorder=5, **mark)
        handles.append(Line2D([], [], ms=7, lw=1.5, label=f"truly near, {s.method}", **mark))
    axes.set_xlim(0, d[-1])
    axes.set_ylim(-0.02, 1.04)
    quiet(axes, "distance on the ground (m)", "probability, or share of pairs")
    axes.text(tau + 0.1, 0.97, f"τ = {tau:g} m", fontsize=TEXT, color=style.AXIS, va="center")
    return style.drawn(fig, handles, 0.4)


def _one_panel() -> tuple[Figure, Axes]:
    fig = style.figure(WIDTH_IN, 4.6)
    return fig, fig.add_axes((0.13, 0.3, 0.84, 0.66))


def _turning(share: Float[np.ndarray, "k"]) -> Bool[np.ndarray, "k"]:
    """Where the share leaves 1 or 0, with a neighbour on both sides: only there marks say more."""
    between = (share > 0) & (share < 1)
    wide = between.copy()
    wide[1:] |= between[:-1]
    wide[:-1] |= between[1:]
    return wide if wide.any() else np.ones(len(share), bool)


def roc_curves(evaluation: Evaluation, shown: Headline) -> list[tuple[float, Roc]]:
    """Heights of people and ROC curves of a headline's line: at the paper's heights, or at all its
    heights where it has none of those; as :attr:`.NearPairs.auc`.
    """
    scored = [(o.person_height_m, o.score) for o in evaluation.of(shown.setting)]
    held = [(h, score.near) for h, score in scored if score and score.near.auc is not None]
    papers = [(h, pairs) for h, pairs in held if h in PAPER_HEIGHTS_M]
    ordered = sorted(papers or held, key=lambda one: one[0])
    return [(h, roc_curve(-pairs.ranked_m, pairs.positive)) for h, pairs in ordered]


def auc_text(auc: float) -> str:
    """Four digits; what is not 1 is not shown as 1."""
    return ">\u00a00.9999" if 0.99995 <= auc < 1 else f"{auc:.4f}"


def draw_roc(evaluation: Evaluation, shown: tuple[Headline, ...]) -> style.Drawn:
    """The ROC curves: a colour for each method, a marker for each height of the people."""
    fig, axes = _one_panel()
    handles = []
    for s in shown:
        for k, (height_m, roc) in enumerate(roc_curves(evaluation, s)):
            line: dict[str, Any] = {"color": s.colour, "lw": 1.7, "marker": _MARKERS[k % 3]}
            apart = (0.05 * k, 0.2)
            begin = int(np.searchsorted(roc.false_rate, _LEAST_FALSE, side="right")) - 1
            x = np.maximum(roc.false_rate[begin:], _LEAST_FALSE)
            axes.plot(x, roc.true_rate[begin:], ms=6, markevery=apart, **line)
            label = f"{s.method}, {height_text(height_m)} m: {auc_text(roc.auc)}"
            handles.append(Line2D([], [], label=label, **line))
    axes.set_xscale("log")
    axes.set_xlim(_LEAST_FALSE, 1)
    axes.set_xticks([1e-3, 1e-2, 1e-1, 1], ["0.001", "0.01", "0.1", "1"])
    axes.set_ylim(0, 1.015)
    quiet(axes, "false positive rate", "true positive rate")
    return style.drawn(fig, handles, 0.4)


def draw_det(evaluation: ActivityEvaluation) -> style.Drawn:
    """The DET curves of every activity that is labelled, in the order of the table."""
    shown = [name for name in evaluation.activities if evaluation.labels[name]]
    rows = max(1, -(-len(shown) // _COLUMNS))
    height = _STRIP_IN + _TOP_IN + rows * _PANEL_IN + (rows - 1) * _BETWEEN_IN
    fig = style.figure(WIDTH_IN, height)
    wide = (WIDTH_IN - _LEFT_IN - 0.1 - (_COLUMNS - 1) * _GAP_IN) / _COLUMNS
    for place, name in enumerate(shown):
        row, column = divmod(place, _COLUMNS)
        below = height - _TOP_IN - _PANEL_IN - row * (_PANEL_IN + _BETWEEN_IN)
        left = _LEFT_IN + column * (wide + _GAP_IN)
        axes = fig.add_axes((left / WIDTH_IN, below / height, wide / WIDTH_IN, _PANEL_IN / height))
        _det_panel(axes, evaluation, name)
        lowest = place + _COLUMNS >= len(shown)
        quiet(axes, "false alarms per minute" if lowest else "", "missed" if column == 0 else "")
        axes.tick_params(labelleft=column == 0, labelbottom=lowest)
    handles = [
        Line2D([], [], color=colour, ls=dashes, lw=width, label=method.name)
        for method, (colour, dashes, width) in zip(evaluation.methods, _METHODS, strict=False)
    ]
    return style.drawn(fig, handles, 0.3)


def _det_panel(axes: Axes, evaluation: ActivityEvaluation, activity: str) -> None:
    for rate in FALSE_PER_MINUTE:
        axes.axvline(rate, color=style.FAINT, lw=0.8, ls=(0, (3, 3)), zorder=1)
    drawn = list(zip(evaluation.methods, _METHODS, strict=False))
    for method, (colour, dashes, width) in reversed(drawn):
        ranked = evaluation.of(method.name, activity).ranked
        if ranked is not None and ranked.det is not None:
            axes.plot(*outline(ranked.det), color=colour, ls=dashes, lw=width, zorder=3)
    axes.set_xscale("log")
    axes.set_xlim(LEAST, MOST)
    axes.set_xticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(-0.02, 1.02)
    axes.set_yticks([0, 0.5, 1])
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, 0))
    title = f"{activity.replace('_', ' ')} ({evaluation.labels[activity]})"
    axes.set_title(title, loc="left", fontsize=SMALL, color=style.AXIS, pad=3)


def outline(curve: DetCurve) -> tuple[np.ndarray, np.ndarray]:
    """The curve over the whole axis: everything is missed left of its first point, and right of
    its last one nothing more is found. Points left of the axis are left out, except for the one
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
