"""P(near) against distance, and its ROC curves (the paper's figures 7 and 8, with our data)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from scene4d.core.people import PERSON_HEIGHT_M
from scene4d.drawing import style
from scene4d.evaluation import PAPER_HEIGHTS_M, Evaluation, NearPairs, Outcome, Roc, roc_curve
from scene4d.evaluation.pages import look
from scene4d.evaluation.pages.headline import Headline
from scene4d.searching.predicates import NEAR_SIGMA_M, NEAR_TAU_M, near_probability

BIN_M, MIN_PAIRS = 0.1, 20
_REACH_M = 2.25
"""The curve is drawn from 0 to so many times τ."""


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
    """How often pairs at an estimated distance are truly near, in bins of :data:`BIN_M` that hold
    at least :data:`MIN_PAIRS`.
    """
    inside = pairs.estimated_m < _REACH_M * pairs.tau_m
    distance, near = pairs.estimated_m[inside], pairs.positive[inside]
    index = (distance / BIN_M).astype(int)
    count = np.bincount(index)
    held = count >= MIN_PAIRS
    total = np.maximum(count, 1)
    mean, share = np.bincount(index, distance) / total, np.bincount(index, near) / total
    return Share(mean[held], share[held], count[held])


def draw_near(shown: tuple[Headline, ...]) -> bytes:
    """PNG of P(near) over distance, with what was truly near at each estimated distance."""
    with_pairs = [(s, s.outcome.near) for s in shown if s.outcome.near is not None]
    tau = with_pairs[0][1].tau_m if with_pairs else NEAR_TAU_M
    fig = style.figure(look.WIDTH_IN, 4.3)
    axes = fig.add_axes((0.1, 0.3, 0.88, 0.67))
    d = np.linspace(0, _REACH_M * tau, 400)
    axes.plot(d, near_probability(d, tau_m=tau), color=style.INK, lw=2.2)
    axes.plot([0, tau, tau, d[-1]], [1, 1, 0, 0], color=style.FAINT, lw=1.2, ls=(0, (4, 3)))
    handles = [
        Line2D([], [], color=style.INK, lw=2.2, label=f"P(near), σ = {NEAR_SIGMA_M:g} m"),
        Line2D([], [], color=style.FAINT, lw=1.2, ls=(0, (4, 3)), label="if distances were exact"),
    ]
    for s, pairs in with_pairs:
        found = near_share(pairs)
        look_of: dict[str, Any] = {
            "color": s.colour,
            "marker": s.marker,
            "mec": "white",
            "mew": 0.5,
        }
        axes.plot(found.distance_m, found.share, color=s.colour, lw=1.5, zorder=4)
        turn = _turning(found.share)
        axes.plot(
            found.distance_m[turn], found.share[turn], ls="", ms=6.5, clip_on=False, zorder=5,
            **look_of,
        )  # fmt: skip
        label = f"truly near, {s.name}"
        handles.append(Line2D([], [], ms=7, lw=1.5, label=label, **look_of))
    axes.set_xlim(0, d[-1])
    axes.set_ylim(-0.02, 1.04)
    look.quiet(axes, "distance on the ground (m)", "probability, or share of pairs")
    axes.text(tau + 0.1, 0.97, f"τ = {tau:g} m", fontsize=look.TEXT, color="#5B636C", va="center")
    style.legend_below(fig, handles, 0.36, columns=2)
    return style.png(fig)


def _turning(share: Float[np.ndarray, "k"]) -> Bool[np.ndarray, "k"]:
    """Where the share leaves 1 or 0, with a neighbour on both sides: only there marks say more."""
    between = (share > 0) & (share < 1)
    wide = between.copy()
    wide[1:] |= between[:-1]
    wide[:-1] |= between[1:]
    return wide if wide.any() else np.ones(len(share), bool)


def roc_outcomes(evaluation: Evaluation, shown: Headline) -> list[tuple[Outcome, Roc]]:
    """The curves of a headline's line at the heights of the paper, or at all its heights where it
    has none of those; ranked by distance, as :func:`.near_figures`.
    """
    held = [o for o in evaluation.of(shown.setting) if o.near is not None and _both(o.near)]
    papers = [o for o in held if any(abs(o.person_height_m - h) < 1e-9 for h in PAPER_HEIGHTS_M)]
    curves = []
    for outcome in sorted(papers or held, key=lambda o: o.person_height_m):
        assert outcome.near is not None
        curves.append((outcome, roc_curve(-outcome.near.estimated_m, outcome.near.positive)))
    return curves


def auc_of(pairs: NearPairs) -> float | None:
    """Area under the ROC curve, as in :func:`.near_figures`; None where one class is empty."""
    return roc_curve(-pairs.estimated_m, pairs.positive).auc if _both(pairs) else None


def _both(pairs: NearPairs) -> bool:
    return 0 < int(pairs.positive.sum()) < len(pairs.positive)


def auc_text(auc: float) -> str:
    """Four digits; what is not 1 is not shown as 1."""
    return ">\u00a00.9999" if 0.99995 <= auc < 1 else f"{auc:.4f}"


def draw_roc(evaluation: Evaluation, shown: tuple[Headline, ...]) -> bytes:
    """PNG of the ROC curves, one panel per method, with the corner enlarged."""
    panels = [(s, curves) for s in shown if (curves := roc_outcomes(evaluation, s))]
    wide = (look.WIDTH_IN - 0.7 - 0.25 - 0.45 * (len(panels) - 1)) / max(len(panels), 2)
    high = wide + 1.9
    fig = style.figure(look.WIDTH_IN, high)
    start = (look.WIDTH_IN - len(panels) * wide - 0.45 * (len(panels) - 1) + 0.45) / 2
    corner = zoom_corner([roc for _, curves in panels for _, roc in curves])
    for k, (s, curves) in enumerate(panels):
        left = (start + k * (wide + 0.45)) / look.WIDTH_IN
        axes = fig.add_axes((left, 1.45 / high, wide / look.WIDTH_IN, wide / high))
        axes.plot([0, 1], [0, 1], color=style.FAINT, lw=0.9, ls=(0, (2, 2)))
        handles = _curves(axes, curves)
        axes.set_xlim(-0.015, 1)
        axes.set_ylim(0, 1.015)
        axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "", "½", "", "1"])
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "", "½", "", "1"])
        look.quiet(axes, "false positive rate", "true positive rate" if k == 0 else "")
        look.heading(axes, s.name)
        _inset(axes, curves, corner)
        look.legend(
            axes, handles, loc="upper left", bbox_to_anchor=(-0.04, -0.19), handlelength=2.2
        )
    return style.png(fig)


def zoom_corner(curves: list[Roc]) -> tuple[float, float] | None:
    """The corner that holds what can be told apart: largest false rate and smallest true rate.

    None where a curve stays far from the corner: the enlargement would lie over it, and without it
    everything can be seen.
    """
    false = [float(np.interp(0.995, roc.true_rate, roc.false_rate)) for roc in curves]
    if max(false) > 0.2:
        return None
    x = _rounded_up(1.15 * max(max(false), 0.002))
    before = [int(np.searchsorted(roc.false_rate, 0.1 * x, "right")) - 1 for roc in curves]
    true = min(float(roc.true_rate[k]) for roc, k in zip(curves, before, strict=True))
    return x, max(0.0, 1 - _rounded_up(1.15 * max(1 - true, 0.005)))


def _rounded_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(f * power for f in (1, 2, 5, 10) if f * power >= value - 1e-12))


def _curves(axes: Axes, curves: list[tuple[Outcome, Roc]]) -> list[Line2D]:
    looks = look.height_looks(sorted({*PAPER_HEIGHTS_M, PERSON_HEIGHT_M}))
    dashes = {0: "solid", 1: (0, (5, 1.5)), 2: (0, (1.5, 1.2))}
    handles = []
    for k, (outcome, roc) in enumerate(curves):
        spare = look.height_looks([o.person_height_m for o, _ in curves])
        height = outcome.person_height_m
        colour, _ = looks.get(height, spare[height])
        axes.plot(roc.false_rate, roc.true_rate, color=colour, lw=1.9, ls=dashes[k % 3])
        label = f"{look.height_text(height)} m: AUC {auc_text(roc.auc)}"
        handles.append(Line2D([], [], color=colour, lw=1.9, ls=dashes[k % 3], label=label))
    return handles


def _inset(
    axes: Axes, curves: list[tuple[Outcome, Roc]], corner: tuple[float, float] | None
) -> None:
    if corner is None:
        return
    x, y = corner
    inset = axes.inset_axes((0.32, 0.16, 0.62, 0.62))
    _curves(inset, curves)
    inset.set_xlim(0, x)
    inset.set_ylim(y, 1 + 0.02 * (1 - y))
    inset.set_xticks([0, x / 2, x], ["0", f"{x / 2:g}", f"{x:g}"])
    inset.set_yticks([y, (1 + y) / 2, 1], [f"{y:g}", f"{(1 + y) / 2:g}", "1"])
    look.quiet(inset)
    inset.spines[["top", "right"]].set_visible(True)
    inset.spines[:].set_color(style.FAINT)
    for label in inset.get_yticklabels():
        label.set_bbox({"fc": "white", "ec": "none", "pad": 1.0})
    inset.set_title("enlarged corner", fontsize=look.SMALL, color="#5B636C", pad=3)
