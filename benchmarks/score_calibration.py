"""Scores as probabilities: counted on the two MEVA cameras that constants are chosen on.

    python -m benchmarks.score_calibration [--data DIR] [--write] [--check]

DIR holds meva/. For each activity with at least 20 labels there, events are matched with labels by
NIST's rule, and the share of right ones is fitted as a rising function of the score: the mean of
beta calibration (Kull et al. 2017; three parameters) and isotonic regression. Where the share of
right events alone says more on the camera left out, there is no probability. The errors of both
curves and of their mean on the camera left out are printed, and how far the cameras differ.

All of it twice: on annotated tracks, and on those that our tracker makes of what a detector would
see of the same boxes (:mod:`benchmarks.simulated_detector`). With --write the result becomes the
file that searches use. With --check the cameras that `scene4d evaluate meva` reports are looked at
instead, through the simulated detector, and nothing is fitted: do the probabilities hold there?
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import isotonic_regression, minimize

from benchmarks import options_of
from benchmarks.simulated_detector import SimulatedDetector
from scene4d.core.progress import Silent
from scene4d.evaluation._options import REPORTED, TUNED
from scene4d.evaluation.datasets._meva import Clip, meva_clips
from scene4d.evaluation.measures._events import NIST, RULES, ClipEvents, Ranked, ranked_clips
from scene4d.evaluation.measures._probability import brier_score, reliability, true_error
from scene4d.evaluation.trials._ways import OURS, Seen
from scene4d.evaluation.trials.activities import labelled_activities
from scene4d.searching.activities import calibrated
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.search import LEAST_SCORE, MIN_SCORE

LEAST_LABELS = 20
"""With fewer the share of right events is known to ±0.1 at best."""
LIMIT = 0.01
"""No event is surer than 1 - LIMIT to be right, or to be wrong: some labels are missing."""
PRIOR = 0.05
"""Weight of the prior that the score is a probability up to a constant, as a normal's precision."""
NOT_OF_DETECTED = (
    "person_enters_vehicle",
    "person_talks_to_person",
    "person_leaves_through_structure",
)
"""Of a detector's tracks these have no probability: with --check they are off by 0.07 to 0.16
without what chance adds, the others by less than 0.06."""
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


Fit = Callable[[np.ndarray, np.ndarray], Curve]
Part = tuple[np.ndarray, np.ndarray]
"""Scores of one camera's events, and which are right."""


def left_out(parts: Sequence[Part], fit: Fit = mean_curve) -> list[np.ndarray]:
    """Probabilities of every camera's events by the curve of the others."""
    out = []
    for number, (score, _) in enumerate(parts):
        rest = [part for k, part in enumerate(parts) if k != number]
        curve = fit(*(np.concatenate(column) for column in zip(*rest, strict=True)))
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


def labelled(clips: Sequence[Clip], least: int) -> Iterator[tuple[str, Activity, list[ClipEvents]]]:
    """Activities with so many labels or more, and what is found of them."""
    seen = Seen(OURS, 1.0, clips)
    for name, activity in labelled_activities().items():
        events = seen.events(activity)
        assert events is not None
        labels = sum(len(clip.label_s) for clip in events)
        if labels < least:
            print(f"{name:32s} {labels:4d} labels: too few")
        else:
            yield name, activity, events


def counted(clips: Sequence[Clip]) -> dict[str, dict]:
    """What the file holds of each activity that can be calibrated."""
    found, everything = {}, []
    for name, activity, events in labelled(clips, LEAST_LABELS):
        matched = ranked_clips(events, RULES[NIST])
        parts = []
        for camera in TUNED:
            own = [one for one, clip in zip(matched, events, strict=True) if clip.camera == camera]
            columns = [(one.score, one.correct) for one in own]
            parts.append(tuple(np.concatenate(column) for column in zip(*columns, strict=True)))
        everything.append(parts)
        labels = sum(len(clip.label_s) for clip in events)
        head = {"fingerprint": calibrated.fingerprint(activity), "cameras": TUNED, "labels": labels}
        result = head | calibrate(parts)
        kept = result["brier_score"] < result["brier_score_of_share"]
        if kept:
            found[name] = result
        said = ("labels", "events", "precision", "expected_error", "brier_score")
        more = ", ".join(f"{key} {result[key]}" for key in said)
        less = "" if kept else ": no better than the share of right events"
        print(f"{name:32s} {more} ({result['brier_score_of_share']}){less}", flush=True)
    compare(everything)
    return found


def compare(everything: Sequence[Sequence[Part]]) -> None:
    """Print what each curve is worth on the camera left out, and how far cameras differ."""
    for fit in (beta_curve, isotonic_curve, mean_curve):
        guesses = [left_out(parts, fit) for parts in everything]
        errors = [
            np.mean([weighed(by, *one) for one in zip(everything, guesses, strict=True)])
            for by in (expected_error, brier_score)
        ]
        print(f"{fit.__name__}: calibration error {errors[0]:.3f}, Brier score {errors[1]:.4f}")
    spread, at_most = camera_spread([camera_difference(parts) for parts in everything])
    print(f"log odds of a camera: standard deviation {spread:.2f}, 95 % below {at_most:.2f}")


def camera_difference(parts: Sequence[Part]) -> tuple[float, float]:
    """By how much the log odds of two cameras' events of one score differ, and its variance: a
    logistic regression on those of the curve of both, with a constant for each camera.
    """
    curve = mean_curve(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    rows, right = [], []
    for camera, (score, correct) in enumerate(parts):
        shown = score >= MIN_SCORE
        p = np.clip(curve(score[shown]), LIMIT, 1 - LIMIT)
        rows.append(np.column_stack([np.log(p / (1 - p)), *np.eye(2)[[camera] * len(p)].T]))
        right.append(correct[shown])
    x, y, w = np.concatenate(rows), np.concatenate(right), np.array([1.0, 0.0, 0.0])
    for _ in range(30):
        p = 1 / (1 + np.exp(-x @ w))
        covariance = np.linalg.inv(x.T @ (x * (p * (1 - p))[:, None]) + 1e-6 * np.eye(3))
        w = w + covariance @ (x.T @ (y - p))
    apart = np.array([0.0, 1.0, -1.0])
    return float(apart @ w), float(apart @ covariance @ apart)


def camera_spread(differences: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Standard deviation between cameras by maximum likelihood over activities, and its upper 95 %
    (profile likelihood). Where it is 0 there is nothing to shrink or to widen.
    """
    d, variance = np.array(differences).T
    tried = np.linspace(0, 2, 401)
    total = 2 * tried[:, None] ** 2 + variance
    loss = (np.log(total) + d**2 / total).sum(axis=1) / 2
    return float(tried[loss.argmin()]), float(tried[loss < loss.min() + 1.92].max())


def check(clips: Sequence[Clip]) -> None:
    """Print how both tables hold on clips that nothing was fitted on."""
    for name, activity, events in labelled(clips, 1):
        one = Ranked.pooled(ranked_clips(events, RULES[NIST]))
        shown = one.score >= MIN_SCORE
        cells = []
        for tracks in (calibrated.DETECTED, calibrated.ANNOTATED):
            known = calibrated.calibration_of(activity, tracks)
            if known is None or not shown.any():
                cells.append(f"{tracks}: none")
                continue
            stated = known.at(one.score[shown])
            diagram = reliability(stated, one.correct[shown])
            true = true_error(diagram)
            cells.append(
                f"{tracks}: stated {stated.mean():.3f}, error {diagram.expected_error:.3f} (by "
                f"chance below {true.chance:.3f}), debiased {true.debiased:.3f} ({true.low:.3f} to "
                f"{true.high:.3f})"
            )
        right = one.correct[shown].mean() if shown.any() else np.nan
        print(
            f"{name}: {one.labels} labels, AP {one.average_precision:.2f}, {shown.sum()} events, "
            f"right {right:.3f}; {'; '.join(cells)}",
            flush=True,
        )


def write(found: dict[str, dict[str, dict]]) -> None:
    """The file that searches use."""
    made = {"written_by": "python -m benchmarks.score_calibration --write"}
    text = json.dumps(made | found, indent=1)
    # Numbers of a curve stand in one line.
    text = re.sub(r"(?<=[\d\[,])\s+(?=[\d\]])", " ", text)
    Path(calibrated.__file__).with_name(calibrated.FILE).write_text(text + "\n")


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--check", action="store_true", help="look at the reported cameras")
    arguments = parser.parse_args()
    meva = arguments.data / "meva"
    detector = SimulatedDetector()
    if arguments.check:
        check(meva_clips(meva, REPORTED, Silent(), detector))
        return
    found = {calibrated.ANNOTATED: counted(meva_clips(meva, TUNED, Silent()))}
    detected = counted(meva_clips(meva, TUNED, Silent(), detector))
    kept = {name: one for name, one in detected.items() if name not in NOT_OF_DETECTED}
    found[calibrated.DETECTED] = kept
    if arguments.write:
        write(found)


if __name__ == "__main__":
    main()
