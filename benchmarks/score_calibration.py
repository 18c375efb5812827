"""Scores as probabilities: counted on the two MEVA cameras that constants are chosen on.

    python -m benchmarks.score_calibration [--data DIR] [--write]

DIR holds meva/. For each activity with at least 20 labels there, events are matched with labels by
NIST's rule, and the share of right ones is fitted as a rising function of the score: the mean of
beta calibration (Kull et al. 2017; three parameters) and isotonic regression. On clips left out its
Brier score, 0.1081, is smaller than that of either, 0.1090 and 0.1096. Where the share of right
events alone says more on cameras left out, there is no probability. With --write the result
becomes the file that searches use. The cameras that `scene4d evaluate meva`
reports are never looked at.
"""

import argparse
import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import isotonic_regression, minimize

from scene4d.core.progress import Silent
from scene4d.evaluation._options import TUNED
from scene4d.evaluation.datasets._meva import Clip, meva_clips
from scene4d.evaluation.measures._events import NIST, RULES, ranked_clips
from scene4d.evaluation.measures._probability import brier_score, reliability
from scene4d.evaluation.trials._ways import OURS, Seen
from scene4d.evaluation.trials.activities import labelled_activities
from scene4d.searching.activities import calibrated
from scene4d.searching.activities.search import LEAST_SCORE, MIN_SCORE

ROOT = Path(__file__).parents[1]
LEAST_LABELS = 20
"""With fewer the share of right events is known to ±0.1 at best."""
LIMIT = 0.01
"""No event is surer than 1 - LIMIT to be right, or to be wrong: some labels are missing."""
PRIOR = 0.05
"""Weight of the prior that the score is a probability up to a constant, as a normal's precision."""
GRID = np.round(np.concatenate([[LEAST_SCORE, 0.005, 0.01, 0.02], np.linspace(0.05, 1, 39)]), 4)

Curve = Callable[[np.ndarray], np.ndarray]


def beta_curve(score: np.ndarray, right: np.ndarray) -> Curve:
    """Beta calibration: the log odds are ``a ln s - b ln(1 - s) + c``, a and b not negative."""

    def terms(s: np.ndarray) -> np.ndarray:
        s = np.clip(s, 1e-4, 1 - 1e-3)
        return np.column_stack([np.log(s), -np.log1p(-s), np.ones_like(s)])

    x = terms(score)

    def loss(w: np.ndarray) -> float:
        z = x @ w
        return float((np.logaddexp(0, z) - right * z).sum() + PRIOR * ((w[:2] - 0.5) ** 2).sum())

    start = np.array([0.5, 0.5, 0.0])
    w = minimize(loss, start, bounds=[(0, None), (0, None), (None, None)]).x
    return lambda s: 1 / (1 + np.exp(-terms(s) @ w))


def isotonic_curve(score: np.ndarray, right: np.ndarray) -> Curve:
    """Pool adjacent violators (Ayer et al. 1955), linear between the events."""
    order = np.argsort(score, kind="stable")
    known, place = np.unique(score[order], return_inverse=True)
    often = np.bincount(place).astype(float)
    share = np.bincount(place, right[order].astype(float)) / often
    fitted = isotonic_regression(share, weights=often).x
    return lambda s: np.interp(s, known, fitted)


def mean_curve(score: np.ndarray, right: np.ndarray) -> Curve:
    """The mean of both: the one is smooth, the other has any shape."""
    beta, isotonic = (fit(score, right) for fit in (beta_curve, isotonic_curve))
    return lambda s: (beta(s) + isotonic(s)) / 2


Part = tuple[np.ndarray, np.ndarray]
"""Scores of one camera's events, and which are right."""


def left_out(parts: Sequence[Part]) -> list[np.ndarray]:
    """Probabilities of every camera's events by the curve of the others."""
    out = []
    for number, (score, _) in enumerate(parts):
        rest = [part for k, part in enumerate(parts) if k != number]
        curve = mean_curve(*(np.concatenate(column) for column in zip(*rest, strict=True)))
        out.append(np.clip(curve(score), LIMIT, 1 - LIMIT))
    return out


def weighed(measure: Callable, parts: Sequence[Part], guesses: Sequence[np.ndarray]) -> float:
    """The mean over cameras of an error of what a search shows by default, weighed by events."""
    found = []
    for (score, right), p in zip(parts, guesses, strict=True):
        shown = score >= MIN_SCORE
        if shown.any():
            found.append((measure(p[shown], right[shown]), int(shown.sum())))
    errors, events = zip(*found, strict=True)
    return float(np.average(errors, weights=events))


def expected_error(p: np.ndarray, right: np.ndarray) -> float:
    """The expected calibration error."""
    return reliability(p, right).expected_error


def calibrate(parts: Sequence[Part]) -> dict:
    """The curve of the scores and outcomes of some cameras, and how good it is."""
    score, right = (np.concatenate(column) for column in zip(*parts, strict=True))
    guesses = left_out(parts)
    probability = np.clip(mean_curve(score, right)(GRID), LIMIT, 1 - LIMIT)
    return {
        "events": len(score),
        "precision": round(float(right[score >= MIN_SCORE].mean()), 3),
        "expected_error": round(weighed(expected_error, parts, guesses), 3),
        "brier_score": round(weighed(brier_score, parts, guesses), 4),
        "brier_score_of_share": round(weighed(lambda _, y: y.var(), parts, guesses), 4),
        "score": GRID.tolist(),
        "probability": np.round(np.maximum.accumulate(probability), 4).tolist(),
    }


def counted(clips: Sequence[Clip]) -> dict[str, dict]:
    """What the file holds of each activity that can be calibrated."""
    seen = Seen(OURS, 1.0, clips)
    found = {}
    for name, activity in labelled_activities().items():
        events = seen.events(activity)
        labels = sum(len(clip.label_s) for clip in events)
        if labels < LEAST_LABELS:
            print(f"{name:24s} {labels:4d} labels: too few")
            continue
        matched = ranked_clips(events, RULES[NIST])
        parts = []
        for camera in TUNED:
            own = [one for one, clip in zip(matched, events, strict=True) if clip.camera == camera]
            columns = [(one.score, one.correct) for one in own]
            parts.append(tuple(np.concatenate(column) for column in zip(*columns, strict=True)))
        head = {"fingerprint": calibrated.fingerprint(activity), "cameras": TUNED, "labels": labels}
        result = head | calibrate(parts)
        kept = result["brier_score"] < result["brier_score_of_share"]
        if kept:
            found[name] = result
        said = ("labels", "events", "precision", "expected_error", "brier_score")
        more = ", ".join(f"{key} {result[key]}" for key in said)
        less = "" if kept else ": no better than the share of right events"
        print(f"{name:24s} {more} ({result['brier_score_of_share']}){less}", flush=True)
    return found


def write(found: dict[str, dict]) -> None:
    """The file that searches use."""
    made = {"written_by": "python -m benchmarks.score_calibration --write"}
    text = json.dumps(made | {"activities": found}, indent=1)
    # Numbers of a curve stand in one line.
    text = re.sub(r"(?<=[\d\[,])\s+(?=[\d\]])", " ", text)
    Path(calibrated.__file__).with_name(calibrated.FILE).write_text(text + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    folder = os.environ.get("SCENE4D_DATA", ROOT.parent / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(folder))
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = counted(meva_clips(arguments.data / "meva", TUNED, Silent()))
    if arguments.write:
        write(found)


if __name__ == "__main__":
    main()
