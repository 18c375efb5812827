"""A scene in a notebook: what is in it, and where everybody went, as HTML with inline SVG."""

from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scene4d.store.query import Scene

_MOST_POSITIONS = 4000
_WIDTH_PX = 360
_COLOURS = {"person": "#0072B2", "bicycle": "#009E73", "motorcycle": "#009E73"}
_VEHICLE = "#D55E00"


def scene_html(scene: "Scene") -> str:
    """A table of what the scene holds beside a plan seen from above."""
    spans = [run.span_s for run in scene.runs if run.span_s]
    length_s = sum(end - begin for begin, end in spans)
    said = {
        "Cameras": ", ".join(scene.cameras),
        "Runs": str(len(scene.runs)),
        "Rows": ", ".join(f"{rows:,} x {name}" for name, rows in scene.classes.items()),
        "Footage": f"{length_s:.1f} s",
    }
    rows = "".join(f"<tr><th>{k}</th><td>{escape(v)}</td></tr>" for k, v in said.items())
    plans = "".join(
        f"<figure>{_plan(scene, camera)}<figcaption>{escape(camera)}</figcaption></figure>"
        for camera in scene.cameras[:1]
    )
    return f"<div><table>{rows}</table>{plans}</div>"


def _plan(scene: "Scene", camera: str) -> str:
    """Paths of one camera's tracks, in metres; north of the picture is +Y."""
    paths = list(scene.paths(camera, _MOST_POSITIONS).values())
    if not paths:
        return ""
    every = np.concatenate([xy for _, xy in paths])
    low, high = np.quantile(every, [0.01, 0.99], axis=0) + np.array([[-1.0], [1.0]])
    width, height = high - low
    lines = []
    for name, xy in paths:
        colour = _COLOURS.get(name, _VEHICLE)
        points = " ".join(f"{x - low[0]:.2f},{high[1] - y:.2f}" for x, y in xy)
        lines.append(f'<polyline points="{points}" stroke="{colour}"/>')
    return (
        f'<svg width="{_WIDTH_PX}" viewBox="0 0 {width:.2f} {height:.2f}" role="img" '
        f'aria-label="Paths on the ground, {width:.0f} m by {height:.0f} m" fill="none" '
        f'stroke-width="{width / 200:.3f}" stroke-linecap="round">{"".join(lines)}</svg>'
    )
