"""A scene in a notebook: what is in it, and where everybody went, as HTML with inline SVG."""

from typing import TYPE_CHECKING

from scene4d.core.notebook import beside, plan_svg

if TYPE_CHECKING:
    from scene4d.store.query import Scene

_MOST_POSITIONS = 4000


def scene_html(scene: "Scene") -> str:
    """A table of what the scene holds beside a plan of its first camera, seen from above."""
    spans = [run.span_s for run in scene.runs if run.span_s]
    length_s = sum(end - begin for begin, end in spans)
    said = {
        "Cameras": ", ".join(scene.cameras),
        "Runs": str(len(scene.runs)),
        "Rows": ", ".join(f"{rows:,} x {name}" for name, rows in scene.classes.items()),
        "Footage": f"{length_s:.1f} s",
    }
    plans = [plan_svg(scene.paths(one, _MOST_POSITIONS).values()) for one in scene.cameras[:1]]
    return beside(said, "".join(plans))
