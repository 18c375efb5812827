"""The pictures of docs/benchmarks.md."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from benchmarks.comparison import FAILED_M, Attempt, grouped, quantiles
from benchmarks.growth import Curve
from benchmarks.tables import IMAGES
from scene4d.core.files import write_bytes
from scene4d.drawing.style import FAINT, INK, INLIER, NORMAL, SMALL, TRACKS, figure, png

OWN = INLIER
LOOKS = ((OWN, "*"), ("#0072B2", "s"), (FAINT, "v"), (TRACKS[0], "^"), (TRACKS[1], "D"),
         (TRACKS[2], "P"), (TRACKS[4], "X"))  # fmt: skip
"""Colour and marker; ours is red."""
FLOOR_M = 0.01


def peers(attempts: list[Attempt]) -> None:
    """Error against time, one panel for each kind of scenes; failures stand on the upper edge."""
    groups = grouped(attempts)
    conditions = list(dict.fromkeys(condition for condition, _ in groups))
    methods = list(dict.fromkeys(method for _, method in groups))
    looks = dict(zip(methods, [(OWN, "o"), *LOOKS], strict=False))
    fig = figure(9.0, 7.6)
    panels = np.ravel(fig.subplots(2, -(-len(conditions) // 2), sharex=True, sharey=True))
    for axes, condition in zip(panels, conditions, strict=False):
        _frame(axes, condition)
        for method in methods:
            mine = [a for a in groups.get((condition, method), []) if a.error_m is not None]
            if mine:
                _cloud(axes, mine, *looks[method])
    for axes in panels[len(conditions) :]:
        axes.set_axis_off()
    for axes in panels[-2:]:
        axes.set_xlabel("time, ms", fontsize=NORMAL)
    for axes in panels[::2]:
        axes.set_ylabel("ground error, m", fontsize=NORMAL)
    handles = [
        panels[0].scatter(
            [], [], s=50, c=looks[m][0], marker=looks[m][1], label=m.name + _told(m.told_focal)
        )
        for m in methods
    ]
    fig.legend(handles=handles, loc="lower center", ncols=3, fontsize=SMALL, frameon=False)
    fig.subplots_adjust(0.08, 0.16, 0.98, 0.95, 0.06, 0.14)
    write_bytes(IMAGES / "benchmark_peers.png", png(fig))


def _told(focal: bool) -> str:
    return " (told the focal length)" if focal else ""


def _frame(axes: Axes, title: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(FLOOR_M, FAILED_M * 1.35)
    axes.axhline(FAILED_M, color=FAINT, lw=0.8, ls=":")
    axes.set_title(title, fontsize=NORMAL, color=INK)
    axes.grid(color="#E3E6E9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.yaxis.set_major_formatter(
        FuncFormatter(lambda y, _: "failed" if y == FAILED_M else f"{y:g}")
    )


def _cloud(axes: Axes, mine: list[Attempt], colour: str, marker: str) -> None:
    errors = [a.error_m for a in mine if a.error_m is not None]
    shown = np.clip(errors, FLOOR_M, FAILED_M)
    times = [1e3 * a.seconds for a in mine]
    axes.scatter(times, shown, s=9, c=colour, marker=marker, alpha=0.35, linewidths=0)
    middle = min(max(quantiles(errors)[0], FLOOR_M), FAILED_M)
    axes.scatter(
        np.median(times), middle, s=75, c=colour, marker=marker, edgecolors="white", zorder=3
    )


def growth(name: str, curves: Sequence[Curve]) -> None:
    """Work on log axes; the dashed line through the last point is proportional growth."""
    fig = figure(4.5 * len(curves), 3.6)
    for axes, curve in zip(np.ravel(fig.subplots(1, len(curves))), curves, strict=True):
        x, y = np.array(curve.x), np.array(curve.y)
        axes.plot(x, y[-1] * x / x[-1], color=FAINT, ls="--", lw=1.0, label="proportional")
        axes.plot(x, y, color=OWN, marker="o", ms=4.5, lw=1.5, label="measured")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(curve.title, fontsize=NORMAL, color=INK)
        axes.set_xlabel(curve.x_label, fontsize=NORMAL)
        axes.set_ylabel(curve.y_label, fontsize=NORMAL)
        axes.grid(color="#E3E6E9", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=SMALL)
        axes.legend(fontsize=SMALL, frameon=False)
    fig.tight_layout()
    write_bytes(IMAGES / f"benchmark_growth_{name}.png", png(fig))
