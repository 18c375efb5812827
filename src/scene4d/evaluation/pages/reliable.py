"""Reliability of P(near): what three readings of it state against how often it came true."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.evaluation import NearPairs, brier_score, reliability
from scene4d.evaluation.pages import look
from scene4d.evaluation.pages.headline import Headline

READINGS = {
    "paper": ("distances exact", "#CC79A7", "s"),
    "expected": ("with the covariance", "#009E73", "D"),
    "below_tau": ("P(distance below τ)", "#22272E", "o"),
}
"""Names as in :func:`.near_figures`, with their words, colour and marker."""
_BINS = 10


def probabilities(pairs: NearPairs) -> dict[str, Float[np.ndarray, "p"]]:
    """The three readings of P(near), by the names of :data:`READINGS`."""
    return {
        "paper": pairs.as_paper(),
        "expected": pairs.expected(),
        "below_tau": pairs.expected(sigma_m=0.0),
    }


def draw_reliability(shown: tuple[Headline, ...]) -> bytes:
    """PNG: one panel per method, stated against observed, over how many pairs stated it."""
    panels = [(s, s.outcome.near) for s in shown if s.outcome.near is not None]
    gap = 0.55
    wide = (look.WIDTH_IN - 0.7 - 0.25 - gap * (len(panels) - 1)) / max(len(panels), 2)
    high = 1.3 + 0.95 + 0.18 + wide + 0.35
    fig = style.figure(look.WIDTH_IN, high)
    start = (look.WIDTH_IN - len(panels) * wide - gap * (len(panels) - 1) + 0.45) / 2
    top = max(len(pairs.true_m) for _, pairs in panels)
    for k, (s, pairs) in enumerate(panels):
        left, share = (start + k * (wide + gap)) / look.WIDTH_IN, wide / look.WIDTH_IN
        strip = fig.add_axes((left, 1.3 / high, share, 0.95 / high))
        axes = fig.add_axes((left, 2.43 / high, share, wide / high))
        handles = _readings(axes, strip, pairs)
        _frame(axes, strip, top, first=k == 0)
        look.heading(axes, s.name)
        look.legend(
            strip, handles, loc="upper left", bbox_to_anchor=(-0.12, -0.42), handlelength=1.6
        )
    return style.png(fig)


def _readings(axes: Axes, strip: Axes, pairs: NearPairs) -> list[Line2D]:
    axes.plot([0, 1], [0, 1], color=style.FAINT, lw=0.9, ls=(0, (2, 2)))
    handles = []
    edges = np.linspace(0, 1, _BINS + 1)
    for name, p in probabilities(pairs).items():
        words, colour, marker = READINGS[name]
        found = reliability(p, pairs.positive, _BINS)
        look_of: dict[str, Any] = {"color": colour, "marker": marker, "mec": "white", "mew": 0.5}
        # The first two nearly agree where the covariance is small: one shows around the other.
        size: dict[str, Any] = {"ms": 6, "lw": 1.3}
        if name == "paper":
            size = {"ms": 9, "lw": 3.2}
        axes.plot(found.stated, found.observed, clip_on=False, zorder=3, **look_of, **size)
        counts = np.histogram(p, edges)[0]
        strip.stairs(np.maximum(counts, 0.5), edges, color=colour, lw=size["lw"], baseline=None)
        label = f"{words}: Brier {brier_score(p, pairs.positive):.4f}"
        handles.append(Line2D([], [], label=label, **look_of, **size))
    return handles


def _frame(axes: Axes, strip: Axes, top: int, *, first: bool) -> None:
    for panel in (axes, strip):
        panel.set_xlim(0, 1)
        panel.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "", "½", "", "1"])
    axes.set_ylim(0, 1)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "", "½", "", "1"])
    strip.set_yscale("log")
    strip.set_ylim(0.5, 2 * top)
    look.quiet(axes, "", "share truly near" if first else "")
    look.quiet(strip, "stated probability", "pairs" if first else "")
    axes.tick_params(labelbottom=False)
    strip.minorticks_off()


def scores(pairs: NearPairs) -> dict[str, float]:
    """Brier scores by the names of :data:`READINGS`."""
    return {name: brier_score(p, pairs.positive) for name, p in probabilities(pairs).items()}
