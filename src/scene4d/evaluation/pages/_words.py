"""The texts of an evaluation page: verdict, paragraphs and captions, filled with numbers."""

import numpy as np

from scene4d.core.ground_map import GroundMap
from scene4d.drawing.words import number
from scene4d.evaluation.pages._charts import auc_text, height_text, near_share
from scene4d.evaluation.pages._headline import Headline, headlines
from scene4d.evaluation.pages._pictures import MAX_PEOPLE
from scene4d.evaluation.trials.outcomes import Evaluation

HEADINGS = {
    "points": "Where it was measured",
    "consensus": "The inliers of the paper’s method",
    "ground_paper": "The ground by the paper’s method",
    "ground_joint": "The ground by the joint method",
    "ground_other": "The estimated ground",
    "rings": "What is near, in the picture",
    "alignment": "True and estimated positions from above",
    "near": "P(near) over distance",
    "roc": "Telling near from far (ROC)",
}
"""Headings of the figures, in the order of the page."""
_ALT = {
    "points": "The scene with numbered points on the ground.",
    "consensus": "The scene with people as lines from foot to head, inliers and outliers.",
    "rings": "The scene with rings on the ground around places, true and estimated.",
    "alignment": "Map of true and estimated points.",
    "near": "Curve of P(near) over distance, and the share of pairs that are truly near.",
    "roc": "ROC curves for several assumed heights of people.",
}
_CAPTIONS = {
    "points": "The correspondence points, numbered as in all figures: picked from where people "
    "walked (or from the points given), each as far as possible on the ground from those before "
    "it.",
    "rings": "The ground within τ of a place, as in the paper’s first figure: who stands in it is "
    "near. Where a method’s ring is larger than the true one it takes people for nearer to one "
    "another than they are.",
    "alignment": "Rings are the true positions; lines to the estimated ones are drawn to scale, "
    "after the best shift and rotation, without scaling.",
    "roc": "A pair is positive if it is truly near; it is ranked by the distance of the person on "
    "the aligned ground from the true place; the number is the AUC. A wrong height of the people "
    "scales the ground, which shows here, as in the paper.",
}
_GROUND_ALT = "The scene with the estimated grid on the ground beside the true one."


def verdict(evaluation: Evaluation) -> str:
    """One sentence with the errors of the methods."""
    shown = headlines(evaluation)
    if not shown:
        return f"There is no result for {evaluation.reference.name}: no row gave one."
    parts = [
        f"{number(s.score.error.mean_m, 2)} ± {_metres(s.score.error.sd_m)} with {s.name}"
        + (f" (given {s.setting.given})" if s.setting.given else "")
        for s in shown
    ]
    text = f"The error of ground positions is {' and '.join(parts)}."
    published = evaluation.published
    if published is not None:
        text += f" Published: {number(published.mean_m, 2)} ± {_metres(published.sd_m)}."
    return text


def paragraphs(evaluation: Evaluation) -> list[str]:
    """What was measured, how the methods compare, and how good P(near) is."""
    shown = headlines(evaluation)
    texts = [
        _measured(evaluation),
        _compared(evaluation, shown),
        _near_figures(shown),
        f"{_published(evaluation)} {_left_out(evaluation)}".strip(),
    ]
    return [text for text in texts if text]


def _measured(evaluation: Evaluation) -> str:
    reference = evaluation.reference
    truth = "map of the ground" if isinstance(reference.truth, GroundMap) else "camera"
    where = " where people walked" if _walked(evaluation) else ""
    return (
        f"{len(reference.points_uv)} points, spread over the ground{where}, were located with each "
        f"calibration and with the true {truth} of {reference.name}. The error is the distance "
        "after the best shift and rotation; a wrong scale counts in full. ± is one standard "
        "deviation over the points, as in the paper."
    )


def _compared(evaluation: Evaluation, shown: tuple[Headline, ...]) -> str:
    if not shown:
        return ""
    names = " and ".join(f"{s.name} ({_basis(s)})" for s in shown)
    text = f"The numbers above are those of {names}."
    if [s.method for s in shown[:2]] == ["paper", "joint"]:
        text += f" {compared(*shown[:2])}"
    return text


def compared(paper: Headline, joint: Headline) -> str:
    """Which of the two is closer, or that the points cannot tell: twice the standard error of
    their mean difference, point by point.
    """
    apart = joint.score.error.distance_m - paper.score.error.distance_m
    mean = float(apart.mean())
    doubt = 2 * float(apart.std(ddof=1)) / np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    if abs(mean) <= doubt:
        text = f"The two differ by {_metres(abs(mean))}, less than {len(apart)} points can resolve."
    else:
        better = "further from" if mean > 0 else "closer to"
        text = f"Here the joint method is {_metres(abs(mean))} {better} the truth."
    if (paper.setting.given, paper.setting.footage) != (joint.setting.given, joint.setting.footage):
        text += " They had different input, so this does not rank the methods."
    return text


def _near_figures(shown: tuple[Headline, ...]) -> str:
    if not shown:
        return ""
    pairs = shown[0].score.near
    total, near = len(pairs.true_m), int(pairs.positive.sum())
    text = (
        f"Of {number(float(total), 0)} pairs of points, {number(float(near), 0)} are truly within "
        f"{pairs.tau_m:g} m."
    )
    for s in shown:
        brier, auc = s.score.near.brier(), s.score.near.auc
        rank = "" if auc is None else f"an AUC of {auc_text(auc)} and "
        text += (
            f" {_upper(s.name)} has {rank}Brier scores of {brier['paper']:.4f} as in the paper, "
            f"{brier['expected']:.4f} with the covariance, and {brier['below_tau']:.4f} for the "
            "plain probability of being this near."
        )
    return (
        f"{text} AUC ranks people on the aligned ground by their distance from the true places, so "
        "that a wrong scale counts. "
        "All pairs share one camera's errors, so a Brier score (0 is perfect) is a single draw."
    )


def _published(evaluation: Evaluation) -> str:
    published = evaluation.published
    if published is None:
        return ""
    return (
        f"The paper reports {number(published.mean_m, 2)} ± {_metres(published.sd_m)} and an AUC "
        f"of {published.auc:g} on this data set, from {published.frames} frames, on its own "
        "points, with the orientation from its network. Rows here that are given the true "
        "orientation have an easier task."
    )


def _left_out(evaluation: Evaluation) -> str:
    settings = evaluation.settings()
    circular = sum(setting.circular for setting in settings)
    refused = sum(all(o.score is None for o in evaluation.of(s)) for s in settings)
    parts = []
    if circular:
        parts.append(
            f"{circular} of {len(settings)} rows had circular input, made from the true camera: "
            "they are shown in grey and support no claim."
        )
    if refused:
        lines = "1 row gave" if refused == 1 else f"{refused} rows gave"
        parts.append(f"{lines} no result; the reason is below the table.")
    return " ".join(parts)


def alternative(name: str) -> str:
    """The alternative text of a figure."""
    return _ALT.get(name, _GROUND_ALT)


def caption(name: str, evaluation: Evaluation) -> str:
    """What a figure shows."""
    shown = headlines(evaluation)
    if name.startswith("ground_"):
        return _ground(next(s for s in shown if s.ground_figure == name))
    if name == "consensus":
        return _consensus(next(s for s in shown if s.method == "paper"))
    if name == "near":
        return _near(shown)
    return _CAPTIONS[name]


def _consensus(shown: Headline) -> str:
    from scene4d.calibration.consensus import TOLERANCE_PX

    found = shown.calibration
    text = (
        f"{_upper(_basis(shown))}. Solid lines with dots are inliers: people whose head is within "
        f"{TOLERANCE_PX:g} pixels of where the estimated camera expects it. Dashed lines with "
        "crosses are outliers."
    )
    if found.frames > 1:
        text += f" People from {number(float(found.frames), 0)} frames are drawn on one image."
    if found.people > MAX_PEOPLE:
        text += " An even sample of the people is drawn."
    return text


def _ground(shown: Headline) -> str:
    error = shown.score.error.distance_m
    worst = int(np.argmax(error))
    return (
        f"{_upper(_basis(shown))}. White: the ground grid of the estimated camera. Dashed: the "
        f"same lines with the true camera. Where the two differ, {shown.name} is wrong: by "
        f"{_metres(float(error.mean()))} on average over the points, and at most by "
        f"{_metres(float(error[worst]))}, at point {worst + 1}."
    )


def _near(shown: tuple[Headline, ...]) -> str:
    text = (
        "The curve is the paper’s P(near). With exact distances it would be a step. The marks are "
        "the correct values: the share of pairs at each estimated distance that are truly near."
    )
    for s in shown:
        half = near_share(s.score.near).falls_below(0.5)
        if half is not None:
            text += f" With {s.name} the share falls below one half at {_metres(half)}."
    return text


def _basis(shown: Headline) -> str:
    """Footage, given values, and the assumed height of people."""
    given = f"; given: {shown.setting.given}" if shown.setting.given else ""
    return f"{shown.setting.footage}{given}; people {height_text(shown.person_height_m)}\u00a0m"


def _walked(evaluation: Evaluation) -> bool:
    """Whether the reference's points are where people walked; a user's own may be anything."""
    return evaluation.name != "custom"


def _metres(value: float) -> str:
    """Metres to the centimetre, with a non-breaking space."""
    return f"{number(value, 2)}\u00a0m"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
