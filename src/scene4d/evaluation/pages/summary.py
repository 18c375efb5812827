"""What the numbers say, in plain words, whoever wins."""

import numpy as np

from scene4d.core.ground_map import GroundMap
from scene4d.drawing.words import number
from scene4d.evaluation import Evaluation
from scene4d.evaluation.pages.captions import metres, told, walked
from scene4d.evaluation.pages.headline import Headline, headlines
from scene4d.evaluation.pages.look import height_text
from scene4d.evaluation.pages.near import auc_of, auc_text
from scene4d.evaluation.pages.reliable import scores


def verdict(evaluation: Evaluation) -> str:
    """One sentence with the errors of the methods."""
    shown = headlines(evaluation)
    if not shown:
        return f"Nothing can be said about {evaluation.reference.name}: no line gave a result."
    parts = [
        f"{number(s.error.mean_m, 2)} ± {metres(s.error.sd_m)} with {s.name}{_given(s)}"
        for s in shown
    ]
    text = f"Places on the ground are off by {' and '.join(parts)}."
    published = evaluation.published
    if published is not None:
        text += f" Published: {number(published.mean_m, 2)} ± {metres(published.sd_m)}."
    return text


def _given(s: Headline) -> str:
    """What a method was told, where that is known."""
    return f" (told {s.setting.given})" if s.setting.given else ""


def paragraphs(evaluation: Evaluation) -> list[str]:
    """What was measured and against what, how the methods compare, and what P(near) is worth."""
    shown = headlines(evaluation)
    texts = [_measured(evaluation), _compared(evaluation, shown), _near(shown, walked(evaluation))]
    texts.append(f"{_published(evaluation)} {_left_out(evaluation)}".strip())
    return [text for text in texts if text]


def _measured(evaluation: Evaluation) -> str:
    reference = evaluation.reference
    truth = "map of the ground" if isinstance(reference.truth, GroundMap) else "camera"
    where = " where people walked" if walked(evaluation) else ""
    return (
        f"{len(reference.points_uv)} places, spread over the ground{where}, were located with each "
        f"calibration and with the true {truth} of {reference.name}. The distance that is left "
        "after the best shift and turn is the error; a wrong scale counts in full. ± is one "
        "standard deviation over the places, as in the paper."
    )


def _compared(evaluation: Evaluation, shown: tuple[Headline, ...]) -> str:
    if not shown:
        return ""
    names = " and ".join(f"{s.name} ({told(s)})" for s in shown)
    parts = [f"The numbers above are those of {names}."]
    by_method = {s.method: s for s in shown}
    if {"paper", "joint"} <= set(by_method):
        parts.append(compared(by_method["paper"], by_method["joint"]))
    over = [text for s in shown if (text := _over_heights(evaluation, s))]
    if over:
        text = "The mean height that people are assumed to have sets the scale: over those tried "
        parts.append(f"{text}the error goes {', and '.join(over)}.")
    return " ".join(parts)


def compared(paper: Headline, joint: Headline) -> str:
    """Which of the two is closer, or that the points cannot tell: twice the standard error of
    their mean difference, point by point.
    """
    apart = joint.error.distance_m - paper.error.distance_m
    mean = float(apart.mean())
    doubt = 2 * float(apart.std(ddof=1)) / np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    if abs(mean) <= doubt:
        text = f"The two differ by {metres(abs(mean))}, less than {len(apart)} points can tell."
    else:
        better = "further from" if mean > 0 else "closer to"
        text = f"Here the joint method is {metres(abs(mean))} {better} the truth."
    if paper.setting.given != joint.setting.given or paper.setting.footage != joint.setting.footage:
        text += " They did not have the same to go on, so this is no contest of equals."
    return text


def _over_heights(evaluation: Evaluation, s: Headline) -> str:
    held = [(o.person_height_m, o.error) for o in evaluation.of(s.setting) if o.error is not None]
    if len(held) < 2:
        return ""
    means = [error.mean_m for _, error in held]
    ends = [held[k][0] for k in (int(np.argmin(means)), int(np.argmax(means)))]
    return (
        f"from {metres(min(means))} (at {height_text(ends[0])}\u00a0m) to {metres(max(means))} "
        f"(at {height_text(ends[1])}\u00a0m) with {s.name}"
    )


def _near(shown: tuple[Headline, ...], people: bool) -> str:
    with_pairs = [(s, s.outcome.near) for s in shown if s.outcome.near is not None]
    if not with_pairs:
        return ""
    pairs = with_pairs[0][1]
    total, near = len(pairs.true_m), int(pairs.positive.sum())
    of = "a person and a place" if people else "places"
    text = (
        f"Of {number(float(total), 0)} pairs of {of} {number(float(near), 0)} truly are within "
        f"{pairs.tau_m:g} m."
    )
    for s, found in with_pairs:
        auc = auc_of(found)
        brier = scores(found)
        text += f" {s.name[:1].upper()}{s.name[1:]} "
        text += "has a " if auc is None else f"ranks them with an AUC of {auc_text(auc)}; its "
        text += (
            f"Brier score {'of' if auc is None else 'is'} {brier['paper']:.4f} as in the paper, "
            f"{brier['expected']:.4f} with the covariance, and {brier['below_tau']:.4f} for the "
            "plain probability that they are that near."
        )
    return text + " An AUC sees the order of distances alone; a wrong scale does not change it."


def _published(evaluation: Evaluation) -> str:
    published = evaluation.published
    if published is None:
        return ""
    return (
        f"The paper reports {number(published.mean_m, 2)} ± {metres(published.sd_m)} and an AUC of "
        f"{published.auc:g} on this data set, from {published.frames} frames, on its own points, "
        "with the orientation that its network found. A line here that was told the true "
        "orientation had an easier task."
    )


def _left_out(evaluation: Evaluation) -> str:
    settings = evaluation.settings()
    circular = sum(setting.circular for setting in settings)
    refused = sum(all(o.error is None for o in evaluation.of(s)) for s in settings)
    parts = []
    if circular:
        parts.append(
            f"{circular} of {len(settings)} lines had circular input, made from the true camera: "
            "they are shown in grey, and nothing here rests on them."
        )
    if refused:
        lines = "1 line gave" if refused == 1 else f"{refused} lines gave"
        parts.append(f"{lines} no result; the reason is below the table.")
    return " ".join(parts)
