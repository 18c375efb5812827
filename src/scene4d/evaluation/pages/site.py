"""The page of a site's evaluation: errors between cameras, the plan with the truth, distances."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.drawing.page import as_shown, made_by, rendered
from scene4d.drawing.site_map import draw_site_map
from scene4d.evaluation.trials.sites import SiteEvaluation

_BAR, _MIDDLE = "#4A90D9", "#E0303A"
_MOST_M = 2.0
_CAPTIONS = {
    "site_plan": "The site from above: squares are the cameras as found, with the 95 % ellipse of "
    "each position; crosses the true cameras, moved rigidly as one to fit best. Coloured ways are "
    "of people whom several cameras saw.",
    "site_people": "How far apart two cameras put one person at one moment, over all moments.",
}
_HEADINGS = {"site_plan": "Cameras and their true places", "site_people": "People seen by several"}


def draw_site(evaluation: SiteEvaluation) -> dict[str, style.Drawn]:
    """Figures by name; those without data are left out."""
    site = evaluation.site
    if not site.cameras:
        return {}
    covariances = {name: site.placements[name].covariance[:2, :2] for name in site.cameras}
    found = evaluation.cameras, covariances, evaluation.ways
    drawn = {"site_plan": draw_site_map(*found, evaluation.aligned)}
    if len(evaluation.people.distance_m):
        drawn["site_people"] = _histogram(evaluation.people.distance_m)
    return drawn


def _histogram(distance_m: np.ndarray) -> style.Drawn:
    fig = style.figure(style.WIDTH_IN, 3.6)
    axes = fig.add_axes((0.09, 0.3, 0.88, 0.64))
    axes.hist(np.minimum(distance_m, _MOST_M), bins=40, range=(0, _MOST_M), color=_BAR)
    middle = float(np.median(distance_m))
    axes.axvline(middle, color=_MIDDLE, lw=1.6)
    axes.set_xlabel(f"distance in metres ({_MOST_M:g} and more in the last bar)", color=style.AXIS)
    axes.set_ylabel("moments", color=style.AXIS)
    axes.tick_params(labelsize=style.NORMAL, colors=style.AXIS)
    label = f"median {middle:.2f} m"
    return style.drawn(fig, [Line2D([], [], color=_MIDDLE, lw=1.6, label=label)], 0.2)


def site_verdict(evaluation: SiteEvaluation) -> str:
    """One sentence: how far off, and whether that was foreseen."""
    pairs = evaluation.pairs
    if not pairs:
        reasons = "; ".join(
            f"{n}: {p.reason}" for n, p in evaluation.site.placements.items() if not p
        )
        return f"No two cameras with a known truth were placed. {reasons}"
    worst = max(pairs, key=lambda pair: pair.position_error_m)
    inside = sum(pair.pose_within_95 for pair in pairs)
    turned_deg = np.median([pair.heading_error_deg for pair in pairs])
    return (
        f"{len(pairs)} pair{'' if len(pairs) == 1 else 's'} of cameras: positions are off by "
        f"{np.median([pair.position_error_m for pair in pairs]):.2f} m in the median (at most "
        f"{worst.position_error_m:.2f} m), headings by {turned_deg:.1f}°; {inside} of {len(pairs)} "
        "lie within the 95 % that the site states."
    )


def site_lines(evaluation: SiteEvaluation) -> list[list[str]]:
    """A row for each pair of cameras."""
    return [
        [
            f"{pair.a} and {pair.b}",
            f"{pair.position_error_m:.2f} (± {pair.position_sigma_m:.2f}) m",
            f"{pair.heading_error_deg:.1f} (± {pair.heading_sigma_deg:.1f})°",
            f"{pair.offset_error_s:.2f} (± {pair.offset_sigma_s:.2f}) s",
            "yes" if pair.pose_within_95 and pair.offset_within_95 else "no",
        ]
        for pair in evaluation.pairs
    ]


COLUMNS = ("Cameras", "Position off by", "Heading off by", "Clock off by", "Within 95 %")


def site_facts(evaluation: SiteEvaluation) -> list[str]:
    """What else was measured, in sentences."""
    said, d, ground = [], evaluation.people.distance_m, evaluation.ground
    if len(d):
        said.append(
            f"{evaluation.people.people} people seen by several cameras: at {len(d):,} moments "
            f"these put them {np.median(d):.2f} m apart in the median, {np.quantile(d, 0.9):.2f} m "
            "at the 90th percentile."
        )
    if ground is not None:
        said.append(
            f"Mean error on the ground where people walked: {ground.site_m:.2f} m for the site as "
            f"a whole; camera by camera {ground.refined_m:.2f} m as the site refined them, "
            f"{ground.alone_m:.2f} m as each was alone."
        )
    undetermined = [f"{n}: {p.reason}" for n, p in evaluation.site.placements.items() if not p]
    return [*said, *(f"Undetermined: {one}." for one in undetermined), *evaluation.notes]


def render_site(
    evaluation: SiteEvaluation, pictures: Mapping[str, style.Drawn], *, command: str | None
) -> str:
    """The page as HTML, with the ``pictures`` inside it."""
    values: dict[str, Any] = {
        "title": evaluation.name,
        "verdict": site_verdict(evaluation),
        "columns": COLUMNS,
        "lines": site_lines(evaluation),
        "facts": site_facts(evaluation),
        "headings": _HEADINGS,
        "figures": as_shown(pictures, _HEADINGS.__getitem__, _CAPTIONS.__getitem__),
        "provenance": [
            ("Cameras", ", ".join(evaluation.site.placements)),
            ("True cameras", ", ".join(evaluation.true)),
            *made_by(command),
        ],
        "timings": [],
    }
    return rendered("scene4d.evaluation.pages", "site.html.j2", values)
