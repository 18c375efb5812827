"""Headings, captions and alternative texts of the figures, with numbers read from the data."""

import numpy as np

from scene4d.drawing.words import number
from scene4d.evaluation import Evaluation, Setting
from scene4d.evaluation.pages.headline import Headline, headlines
from scene4d.evaluation.pages.look import height_text
from scene4d.evaluation.pages.near import auc_text, near_share, roc_outcomes
from scene4d.evaluation.pages.pictures import MAX_PEOPLE
from scene4d.evaluation.pages.reliable import READINGS, scores
from scene4d.searching.predicates import NEAR_SIGMA_M

HEADINGS = {
    "settings": "Every setting at a glance",
    "points": "Where it was measured",
    "consensus": "Whom the paper’s method believes",
    "ground_paper": "The ground by the paper’s method",
    "ground_joint": "The ground by the joint method",
    "ground_other": "The estimated ground",
    "alignment": "True and estimated places from above",
    "near": "P(near): what it says, and what is so",
    "roc": "Telling near from far (ROC)",
    "reliability": "P(near) as a probability",
}
_ALT = {
    "settings": "Dot plot: correspondence error of every setting at each assumed height.",
    "points": "The scene with numbered points on the ground.",
    "consensus": "The scene with people as lines from foot to head, inliers and outliers.",
    "alignment": "Map of true and estimated points, and bars of how far each one is off.",
    "near": "Curve of P(near) over distance beside the share of pairs that is truly near.",
    "roc": "ROC curves for several assumed heights, with the corner enlarged.",
    "reliability": "Reliability diagram of three readings of P(near), above a histogram.",
}


def words_for_picture(name: str) -> str:
    """The alternative text, for readers who do not see the picture."""
    ground = "The scene with the estimated grid on the ground beside the true one."
    return _ALT.get(name, ground)


def caption(name: str, evaluation: Evaluation) -> str:
    """What to see in a figure."""
    shown = headlines(evaluation)
    if name.startswith("ground_"):
        return _ground(next(s for s in shown if s.ground_figure == name))
    if name == "settings":
        return _settings(evaluation)
    if name == "points":
        return _points(evaluation)
    if name == "consensus":
        return _consensus(next(s for s in shown if s.method == "paper"))
    if name == "alignment":
        return _alignment(shown)
    if name == "near":
        return _near(shown)
    return _roc(evaluation, shown) if name == "roc" else _reliability(shown)


def given(setting: Setting, separator: str = "; ") -> str:
    """What a line was given beforehand, behind a separator; nothing where that is not known."""
    return f"{separator}given: {setting.given}" if setting.given else ""


def told(shown: Headline) -> str:
    """Footage, what was given, and the assumed height, for a caption."""
    s = shown.setting
    height = height_text(shown.outcome.person_height_m)
    return f"{s.footage}{given(s)}; people {height}\u00a0m"


def walked(evaluation: Evaluation) -> bool:
    """Whether the reference's points are where people walked; a user's own may be anything."""
    return evaluation.name != "custom"


def metres(value: float) -> str:
    """Metres to the centimetre, with a gap that does not break."""
    return f"{number(value, 2)}\u00a0m"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]


def _points(evaluation: Evaluation) -> str:
    count = len(evaluation.reference.points_uv)
    among = "where people walked" if walked(evaluation) else "all points given"
    return (
        f"The {count} correspondence points, with the numbers that they have in all figures. They "
        f"were picked from {among}, each as far as possible from those before it on the ground, so "
        "they seem denser where the ground is far away."
    )


def _consensus(shown: Headline) -> str:
    from scene4d.calibration.consensus import TOLERANCE_PX

    found = shown.calibration
    share = f"{100 * found.inliers / max(found.people, 1):.0f} %"
    text = (
        f"{_upper(told(shown))}. Solid lines with dots are inliers: of "
        f"{number(float(found.people), 0)} people {number(float(found.inliers), 0)} ({share}) have "
        f"their head within {TOLERANCE_PX:g} pixels of where the estimated camera expects it. "
        "Dashed lines with crosses are the others."
    )
    if found.frames > 1:
        text += f" People of {number(float(found.frames), 0)} frames are laid over one picture."
    if found.people > MAX_PEOPLE:
        text += " An even sample of the people is drawn."
    return text


def _ground(shown: Headline) -> str:
    error = shown.error.distance_m
    worst = int(np.argmax(error))
    return (
        f"{_upper(told(shown))}. White: the grid of the estimated camera on the ground. Dashed: "
        f"where the same lines truly run. Where the two part, {shown.name} is wrong: by "
        f"{metres(float(error.mean()))} on average over the points, and most, by "
        f"{metres(float(error[worst]))}, at point {worst + 1}."
    )


def _alignment(shown: tuple[Headline, ...]) -> str:
    parts = []
    for s in shown:
        worst = int(np.argmax(s.error.distance_m))
        parts.append(
            f"{s.name} is off by {number(s.error.mean_m, 2)} ± {metres(s.error.sd_m)}, most at "
            f"point {worst + 1} ({metres(float(s.error.distance_m[worst]))})"
        )
    return (
        "Rings are the true places; the lines to the estimated ones are drawn to scale, after the "
        f"best shift and turn, without scaling. {_upper('; '.join(parts))}. Below: the same "
        "distances, point by point, with the mean dashed."
    )


def _near(shown: tuple[Headline, ...]) -> str:
    from scipy.special import ndtri

    tau = next(s.outcome.near.tau_m for s in shown if s.outcome.near is not None)
    reach = float(ndtri(0.9)) * NEAR_SIGMA_M
    parts = [
        f"The curve is the paper’s, ½ (1 − erf((d − τ) / (√2 σ))) with τ = {tau:g} m and σ = "
        f"{NEAR_SIGMA_M:g} m: it falls from 90 % to 10 % between {metres(tau - reach)} and "
        f"{metres(tau + reach)}. With exact distances it would be a step. The marks are what it "
        "should have been: the share of pairs at each estimated distance that truly are near."
    ]
    for s in shown:
        if s.outcome.near is None:
            continue
        found = near_share(s.outcome.near)
        high, half, low = (found.falls_below(level) for level in (0.9, 0.5, 0.1))
        if high is None or half is None or low is None:
            continue
        text = f"With {s.name} the share falls from 90 % to 10 % between {metres(high)} and "
        text += f"{metres(low)}, and through one half at {metres(half)}"
        bias = half / tau - 1
        if abs(bias) >= 0.01:
            kind = "short" if bias < 0 else "long"
            text += f": its distances come out {100 * abs(bias):.0f} % too {kind}"
        parts.append(text + ".")
    return " ".join(parts)


def _roc(evaluation: Evaluation, shown: tuple[Headline, ...]) -> str:
    people = "A pair of a person and a place" if walked(evaluation) else "A pair of places"
    parts = []
    for s in shown:
        curves = roc_outcomes(evaluation, s)
        if not curves:
            continue
        low, high = (f(roc.auc for _, roc in curves) for f in (min, max))
        span = auc_text(low)
        if auc_text(low) != auc_text(high):
            span += f" to {auc_text(high)}"
        parts.append(f"{s.name} ({s.setting.footage}{given(s.setting)}) {span}")
    return (
        f"{people} is positive where it truly is near; its score is P(near) "
        f"of the estimated distance. AUC: {'; '.join(parts)}. The order of the distances alone "
        "counts, and a wrong height of the people scales all distances alike: so the curves of a "
        "method hardly differ, and an AUC near 1 does not say that distances are right."
    )


def _reliability(shown: tuple[Headline, ...]) -> str:
    parts = []
    for s in shown:
        if s.outcome.near is not None:
            found = scores(s.outcome.near)
            words = ", ".join(f"{found[name]:.4f} {READINGS[name][0]}" for name in READINGS)
            parts.append(f"{s.name} {words}")
    return (
        "On the diagonal a probability comes true as often as it says; below are the pairs that "
        f"stated it. Brier score, where 0 is perfect: {'; '.join(parts)}. The first two hedge by σ "
        "even where a distance is exact. All pairs share the few errors of one camera, so this is "
        "one draw, however many pairs there are."
    )


def _settings(evaluation: Evaluation) -> str:
    held = [o for o in evaluation.outcomes if o.error is not None and not o.setting.circular]
    text = "Marks are means over the points, bars one standard deviation to either side."
    if held:
        means = [o.error.mean_m for o in held if o.error is not None]
        least, most = held[int(np.argmin(means))], held[int(np.argmax(means))]
        ends = [
            f"{metres(mean)} ({o.setting.footage}, {o.setting.method}{given(o.setting, ', ')}, "
            f"people {height_text(o.person_height_m)}\u00a0m)"
            for mean, o in ((min(means), least), (max(means), most))
        ]
        text += f" They run from {ends[0]} to {ends[1]}." if len(held) > 1 else ""
    if evaluation.published is not None:
        text += " The band is what the paper published, on its own points."
    if any(setting.circular for setting in evaluation.settings()):
        text += " Grey lines had circular input and are no evidence."
    return text
