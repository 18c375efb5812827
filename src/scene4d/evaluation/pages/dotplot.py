"""Correspondence error of every setting at every assumed height, in one picture."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from scene4d.drawing import style
from scene4d.drawing.words import number
from scene4d.evaluation import Evaluation, Outcome, Setting
from scene4d.evaluation.pages import look
from scene4d.evaluation.pages.captions import given

_TEXT_IN, _DOTS_IN, _STEP_IN = 0.17, 0.5, 0.09
_LETTERS = 96  # of a setting's name in one line
_BAND, _CIRCULAR = "#DCE9F3", "#8A929C"


def heights(evaluation: Evaluation) -> list[float]:
    """The assumed mean heights of people, from small to tall."""
    return sorted({outcome.person_height_m for outcome in evaluation.outcomes})


def draw_settings(evaluation: Evaluation) -> bytes:
    """PNG: one line per setting, mean and standard deviation at each assumed height."""
    settings = evaluation.settings()
    names = [textwrap.wrap(_name(setting), _LETTERS) for setting in settings]
    # One unit of the axis is one inch, so that names may take as many lines as they need.
    tops = np.cumsum([0.0, *(_TEXT_IN * len(lines) + _DOTS_IN for lines in names)])
    bottom, top = 1.25, 0.42 if evaluation.published else 0.15
    tall = float(tops[-1])
    high = bottom + tall + top
    fig = style.figure(look.WIDTH_IN, high)
    axes = fig.add_axes((0.03, bottom / high, 0.94, tall / high))
    limit = axis_limit(evaluation)
    axes.set_xlim(0, limit)
    axes.set_ylim(tall, 0)
    axes.set_yticks([])
    look.quiet(axes, "correspondence error (m), mean ± one standard deviation", grid="x")
    axes.spines["left"].set_visible(False)
    looks = look.height_looks(heights(evaluation))
    for setting, lines, start in zip(settings, names, tops[:-1], strict=True):
        if start:
            axes.axhline(start, color=look.GRID, lw=0.8)
        _heading(axes, float(start), "\n".join(lines), grey=setting.circular)
        middle = float(start) + _TEXT_IN * len(lines) + _DOTS_IN / 2
        _dots(axes, middle, evaluation.of(setting), looks, limit)
    handles = [*_handles(looks, settings), *_published(axes, evaluation)]
    style.legend_below(fig, handles, 0.36, columns=3 if len(handles) > 4 else 4)
    return style.png(fig)


def _name(setting: Setting) -> str:
    name = f"{setting.footage} · {setting.method}{given(setting, ' · ')}"
    return name + " · circular, no evidence" if setting.circular else name


def axis_limit(evaluation: Evaluation) -> float:
    """Right end of the axis in metres: all bars, but not beyond six times the middle mean.

    One failed calibration must not squeeze the others into a corner; it is written at the edge.
    """
    ends = [o.error.mean_m + o.error.sd_m for o in evaluation.outcomes if o.error is not None]
    means = [o.error.mean_m for o in evaluation.outcomes if o.error is not None]
    limit = min(max(ends, default=1.0), 6 * float(np.median(means)) if means else 1.0)
    if evaluation.published is not None:
        limit = max(limit, evaluation.published.mean_m + evaluation.published.sd_m)
    return 1.06 * max(limit, 0.1)


def _heading(axes: Axes, at: float, name: str, *, grey: bool) -> None:
    """The setting's name above its dots: no margin would be wide enough for all names."""
    axes.annotate(
        name, (0, at), xytext=(3, -3), textcoords="offset points", va="top",
        fontsize=look.SMALL, color="#5B636C" if grey else style.INK, zorder=6,
        style="italic" if grey else "normal",
        bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip


def _dots(
    axes: Axes,
    middle: float,
    outcomes: list[Outcome],
    looks: dict[float, tuple[str, str]],
    limit: float,
) -> None:
    held = [o for o in outcomes if o.error is not None]
    _refused(axes, middle, outcomes, held)
    beyond = []
    for outcome in held:
        assert outcome.error is not None
        colour, marker = looks[outcome.person_height_m]
        colour = _CIRCULAR if outcome.setting.circular else colour
        rank = list(looks).index(outcome.person_height_m)
        at = middle + _STEP_IN * (rank - (len(looks) - 1) / 2)
        mean, sd = outcome.error.mean_m, outcome.error.sd_m
        if mean > limit:
            beyond.append(f"{number(mean, 1)} m")
            axes.plot([0.985 * limit], [at], ls="", marker=">", ms=6, color=colour)
            continue
        axes.plot([max(mean - sd, 0), mean + sd], [at, at], color=colour, lw=1.5, alpha=0.75)
        axes.plot([mean], [at], ls="", marker=marker, ms=6.5, color=colour, mec="white", mew=0.5)
    if beyond:
        axes.text(
            0.96 * limit, middle, "off the scale: " + ", ".join(beyond), ha="right",
            va="center", fontsize=look.SMALL, color=style.INK,
        )  # fmt: skip


def _refused(axes: Axes, middle: float, outcomes: list[Outcome], held: list[Outcome]) -> None:
    missing = [look.height_text(o.person_height_m) for o in outcomes if o.error is None]
    if not missing:
        return
    text, at = "no result (the reason is in the table)", middle
    if held:
        text, at = f"no result at {', '.join(missing)} m", middle + 0.4 * _DOTS_IN
    axes.annotate(
        text, (1, at), xycoords=("axes fraction", "data"), xytext=(-4, 0),
        textcoords="offset points", ha="right", va="center",
        fontsize=look.SMALL, color="#5B636C", style="italic",
    )  # fmt: skip


def _handles(looks: dict[float, tuple[str, str]], settings: list[Setting]) -> list[Any]:
    handles = []
    for height, (colour, marker) in looks.items():
        mark: dict[str, Any] = {
            "marker": marker,
            "ms": 7,
            "color": colour,
            "mec": "white",
            "lw": 1.5,
        }
        handles.append(Line2D([], [], label=f"people {look.height_text(height)} m", **mark))
    if any(setting.circular for setting in settings):
        handles.append(Line2D([], [], color=_CIRCULAR, lw=1.5, label="circular input"))
    return handles


def _published(axes: Axes, evaluation: Evaluation) -> list[Any]:
    published = evaluation.published
    if published is None:
        return []
    low, high = max(published.mean_m - published.sd_m, 0), published.mean_m + published.sd_m
    axes.axvspan(low, high, color=_BAND, lw=0, zorder=0)
    axes.axvline(published.mean_m, color="#1F5F99", lw=1.4, zorder=1)
    axes.annotate(
        f"published {published.mean_m:.2f} ± {published.sd_m:.2f} m",
        (published.mean_m, 1), xycoords=("data", "axes fraction"), xytext=(0, 4),
        textcoords="offset points", ha="center", va="bottom", fontsize=look.SMALL, color="#1F5F99",
    )  # fmt: skip
    return [Patch(color=_BAND, label="published, ± one sd")]
