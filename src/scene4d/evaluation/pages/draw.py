"""All figures of an evaluation for which there is data."""

from scene4d.evaluation import Evaluation

FIGURES: tuple[str, ...] = (
    "settings",
    "points",
    "consensus",
    "ground_paper",
    "ground_joint",
    "ground_other",
    "alignment",
    "near",
    "roc",
    "reliability",
)
"""Names of the figures, in the order of the page; those without data are left out."""


def draw_evaluation(evaluation: Evaluation) -> dict[str, bytes]:
    """PNG bytes by name, in the order of :data:`FIGURES`, of the figures that can be drawn.

    Which outcomes stand for a method is said in ``headline.RULE``. Raises :class:`InputError` for
    a picture of another size than the footage, and where there are too few correspondence points.
    """
    from scene4d.evaluation.pages.alignment import draw_alignment
    from scene4d.evaluation.pages.dotplot import draw_settings
    from scene4d.evaluation.pages.headline import headlines
    from scene4d.evaluation.pages.near import draw_near, draw_roc, roc_outcomes
    from scene4d.evaluation.pages.pictures import draw_consensus, draw_ground, draw_points
    from scene4d.evaluation.pages.reliable import draw_reliability

    shown = headlines(evaluation)
    drawn: dict[str, bytes] = {}
    if evaluation.image_bgr is not None:
        drawn["points"] = draw_points(evaluation)
    for s in shown:
        found = s.calibration
        if s.method == "paper" and found.segments is not None and found.inlier is not None:
            drawn["consensus"] = draw_consensus(evaluation, s)
        drawn[s.ground_figure] = draw_ground(evaluation, s)
    if shown:
        drawn["alignment"] = draw_alignment(shown)
    if any(s.outcome.near is not None for s in shown):
        drawn["near"] = draw_near(shown)
        drawn["reliability"] = draw_reliability(shown)
    if any(roc_outcomes(evaluation, s) for s in shown):
        drawn["roc"] = draw_roc(evaluation, shown)
    if any(outcome.error is not None for outcome in evaluation.outcomes):
        drawn["settings"] = draw_settings(evaluation)
    return {name: drawn[name] for name in FIGURES if name in drawn}
