"""Captions and alternative texts of the figures."""

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.drawing.birdseye import MAX_DOTS as ABOVE_DOTS
from scene4d.drawing.histogram import inlier_heights
from scene4d.drawing.overlay import MAX_DOTS, horizon_shown, people_of
from scene4d.drawing.regions import height_text


def caption(name: str, calibration: Calibration, network: Camera | None = None) -> str:
    """The caption of a figure; ``network`` is the orientation network's estimate of the camera."""
    dashed = ""
    if network is not None and horizon_shown(network):
        dashed = (
            " The thin dashed line is the horizon according to the orientation network, which does "
            "not use the people: a second opinion."
        )
    if not calibration:
        return (
            "The people that were found. Without a camera, little else can be shown."
            + dashed
            + _sample(calibration, MAX_DOTS)
        )
    height = f"{calibration.person_height_m:.2f}"
    texts = {
        "overlay": (
            f"What to check: {_horizon(calibration)}the uprights stand on the ground and are as "
            f"tall as a person of {height} m next to them; the short white ticks are parallel to "
            "building corners and poles."
            + dashed
            + _regions(calibration)
            + _sample(calibration, MAX_DOTS)
        ),
        "birdseye": (
            "The frame projected onto the ground. Straight kerbs and markings should look "
            "straight, right angles right, and lengths should match the grid. Upright objects are "
            "smeared away from the camera." + _sample(calibration, ABOVE_DOTS)
        ),
        "errormap": (
            "Predicted error (one standard deviation) of ground positions within the scene, by "
            "their place in the frame. A shift or rotation of the whole scene is not counted. "
            "There is no ground above the horizon."
        ),
        "heights": _heights(calibration),
    }
    return texts[name]


def words_for_picture(name: str, calibration: Calibration) -> str:
    """The alternative text of a figure."""
    seen = f"{calibration.people} sightings of people"
    if not calibration:
        return f"The frame with {seen} marked by their feet and heads; no geometry."
    agreed = f"{seen}, {calibration.inliers} of them inliers"
    texts = {
        "overlay": (
            f"The frame with the horizon, the ground grid, {agreed}, and uprights of "
            f"{calibration.person_height_m:.2f} m on the ground."
        ),
        "birdseye": f"The ground from above with a grid in metres, the camera, and {agreed}.",
        "errormap": "The frame under bands of the predicted ground error, growing with distance.",
        "heights": "Histogram of people's heights. " + _heights(calibration),
    }
    return texts[name]


def _horizon(calibration: Calibration) -> str:
    if calibration.camera is None or not horizon_shown(calibration.camera):
        return ""
    return "the horizon lies where an endless flat ground would end; "


def _heights(calibration: Calibration) -> str:
    heights, _ = inlier_heights(calibration)
    if len(heights) == 0:
        return "No height could be measured."
    q10, median, q90 = np.percentile(heights, [10, 50, 90])
    return (
        f"The median height of the sightings is {median:.2f} m, and eight in ten lie between "
        f"{q10:.2f} and {q90:.2f} m; {calibration.person_height_m:.2f} m was assumed. Expect one "
        "peak at the assumed mean, with spikes for people who stayed long; a second peak far below "
        "it means children or seated people."
    )


def _regions(calibration: Calibration) -> str:
    if not calibration.ground_regions:
        return ""
    height = height_text(calibration.ground_regions[0])
    return (
        f" The dashed outline is ground of another level ({height}), as people stand there; the "
        "uprights and the grid are on that of the camera."
    )


def _sample(calibration: Calibration, limit: int) -> str:
    _, used = people_of(calibration)
    return " An even sample of the people is drawn." if len(used) > limit else ""
