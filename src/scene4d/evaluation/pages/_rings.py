"""What is near a place, in the picture: figure 1 of Wagner et al. (2019)."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.drawing.scenery import image_of, in_frame
from scene4d.evaluation.datasets._reference import Reference
from scene4d.evaluation.pages._headline import Headline
from scene4d.evaluation.pages._pictures import TRUE_COLOUR, true_image
from scene4d.evaluation.trials.outcomes import Evaluation

_TURN = np.linspace(0, 2 * np.pi, 181)
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
_MOST = 3
"""Rings that are drawn: more hide one another."""
_VISIBLE = 0.6
"""Share of a ring that must be in the picture."""


def draw_rings(evaluation: Evaluation, shown: tuple[Headline, ...]) -> style.Drawn | None:
    """The ring of τ on the ground around some places, in truth and by each method; None where no
    ring is in the picture.
    """
    reference, tau_m = evaluation.reference, shown[0].score.near.tau_m
    places = ringed_places(reference, tau_m)
    if len(places) == 0:
        return None
    image = style.checked_image(evaluation.image_bgr, reference.image_size)
    fig, axes, strip = style.picture(image, reference.image_size, grey=True)
    dark: dict[str, Any] = {"path_effects": style.halo(2.6)}
    handles = []
    for s in shown:
        at = s.score.camera.locate(places)[0]
        rings = [
            image_of(s.score.camera, np.column_stack([xy + tau_m * _CIRCLE, 0 * _TURN]))
            for xy in at
        ]
        axes.add_collection(LineCollection(rings, colors=s.colour, linewidths=1.8, **dark))
        handles.append(Line2D([], [], color=s.colour, lw=1.8, label=s.method, **dark))
    look: dict[str, Any] = {"linestyles": (0, (3, 2)), "linewidths": 1.6}
    rings = [true_ring(reference, uv, tau_m) for uv in places]
    axes.add_collection(LineCollection(rings, colors=TRUE_COLOUR, zorder=4, **look))
    handles.append(Line2D([], [], color=TRUE_COLOUR, lw=1.6, ls=(0, (3, 2)), label="truth", **dark))
    style.scatter(axes, places, s=26, c=TRUE_COLOUR, edgecolors=style.INK, lw=1.0, zorder=5)
    return style.drawn(fig, handles, strip)


def ringed_places(reference: Reference, tau_m: float) -> Float[np.ndarray, "k 2"]:
    """Pixels of the first vehicles, or correspondence points, whose true ring is in the picture and
    away from the rings before it.
    """
    given = reference.points_uv if reference.vehicle_uv is None else reference.vehicle_uv
    there, on_ground = reference.locate(given)
    chosen: list[int] = []
    for row in np.flatnonzero(on_ground):
        apart = np.hypot(*(there[chosen] - there[row]).T)
        seen = in_frame(true_ring(reference, given[row], tau_m), reference.image_size)
        if seen.mean() >= _VISIBLE and (apart > 2 * tau_m).all():
            chosen.append(int(row))
    return given[chosen[:_MOST]]


def true_ring(
    reference: Reference, uv: Float[np.ndarray, "2"], tau_m: float
) -> Float[np.ndarray, "k 2"]:
    """The ring around a place, in pixels of the footage; NaN where it is not visible."""
    return true_image(reference, reference.locate(uv[None])[0] + tau_m * _CIRCLE)
