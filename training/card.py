"""Measure the network on pictures it never saw, for its model card: ``python -m training.card``.

    python -m training.card --data ../shared/data [--network FILE] [--write docs/orientation.md]

With ``--fit`` the exponents are fitted on the validation panoramas instead (for training.export).
"""

import argparse
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scene4d.perception.orientation import Belief, OrientationNetwork, fused, modal
from scene4d.perception.orientation.lines import line_log_likelihood
from training.cases import (
    Case,
    blurred,
    degraded_like_training,
    held_out,
    hopeless,
    real_cameras,
)
from training.fields import field_belief
from training.panoramas import Panorama, read_panoramas

SEED = 20
Reader = Callable[[np.ndarray], Belief]
FIELD_POWER = 0.05
LINE_POWER = 1.0
"""Exponents of the dense head's and the lines' likelihoods, fitted like the network's."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Median absolute errors in degrees (roll, tilt, vfov), coverage of 95 %, and log score."""

    median_deg: np.ndarray
    coverage: np.ndarray
    width_deg: np.ndarray
    log_score: float
    count: int


def score(cases: Iterable[Case], read: Reader) -> Scores:
    """Posterior means against the truth, and how often 95 % intervals hold it."""
    errors, inside, widths, logs = [], [], [], []
    for case in cases:
        belief = read(case.picture_bgr)
        errors.append(np.abs(belief.mean() - case.truth_rad))
        ends = np.array([belief.interval(axis) for axis in range(3)])
        inside.append((ends[:, 0] <= case.truth_rad) & (case.truth_rad <= ends[:, 1]))
        widths.append(ends[:, 1] - ends[:, 0])
        logs.append(belief.log_density_at(*case.truth_rad))
    return Scores(
        np.degrees(np.median(errors, axis=0)),
        np.mean(inside, axis=0),
        np.degrees(np.median(widths, axis=0)),
        float(np.mean(logs)),
        len(errors),
    )


def readers(network: OrientationNetwork) -> dict[str, Reader]:
    """Both designs, the classical baseline, and a guess that knows the pictures' ranges."""
    middle = (0.0, np.radians(20), np.log(np.radians(37.4)))
    guess = Belief.gaussian(middle, (np.radians(5), np.radians(17), 0.36))  # what held_out draws

    def dense(picture: np.ndarray) -> Belief:
        return field_belief(network.outputs(picture)[0], FIELD_POWER)

    def lines(picture: np.ndarray) -> Belief:
        return Belief.normalised(LINE_POWER * line_log_likelihood(picture))

    def with_lines(picture: np.ndarray) -> Belief:
        return Belief.normalised(network.belief(picture).log_p + lines(picture).log_p)

    def with_dense(picture: np.ndarray) -> Belief:
        both = network.belief(picture).log_p + dense(picture).log_p
        return Belief.normalised(both / 2)

    return {
        "best constant guess": lambda picture: guess,
        "lines and vanishing points": lines,
        "dense head (up and latitude)": dense,
        "bins": network.belief,
        "bins + dense head": with_dense,
        "bins + lines": with_lines,
    }


def _row(name: str, scores: Scores) -> str:
    roll, tilt, vfov = scores.median_deg
    held = " / ".join(f"{share:.0%}" for share in scores.coverage)
    return f"| {name} | {roll:.2f} | {tilt:.2f} | {vfov:.2f} | {held} | {scores.log_score:.2f} |"


_HEAD = (
    "| | roll ° | tilt ° | vertical field of view ° | in the 95 % interval | log score |\n"
    "| --- | ---: | ---: | ---: | ---: | ---: |"
)


def measured(data: Path, network: OrientationNetwork) -> str:
    """All tables, in Markdown."""
    test = read_panoramas(data / "panoramas", "test")
    cases = list(held_out(test, SEED))
    lines = [f"Median absolute errors on {len(cases)} crops of {len(test)} panoramas.", "", _HEAD]
    for name, read in readers(network).items():
        lines.append(_row(name, score(cases, read)))
    lines += ["", "The same crops, made worse; the network's bins.", "", _HEAD]
    for sigma in (1.0, 2.0, 3.0):
        lines.append(_row(f"blurred, σ {sigma:g} px", score(blurred(cases, sigma), network.belief)))
    worse = degraded_like_training(test, SEED, len(cases))
    lines.append(_row("all weathers and ranges of training", score(worse, network.belief)))
    lines += ["", *_real(data, network), "", *_hopeless(test, network)]
    return "\n".join(lines)


def _real(data: Path, network: OrientationNetwork) -> list[str]:
    lines = [
        "Real fixed cameras, never trained on: found ± σ (true), degrees.",
        "",
        "| camera | frames | roll | tilt | vertical field of view | mode over frames |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    errors = []
    for name, cases in real_cameras(data):
        beliefs = [network.belief(case.picture_bgr) for case in cases]
        belief, truth = fused(beliefs), np.degrees(cases[0].truth_rad)
        found, sigma = np.degrees(belief.mean()), np.degrees(belief.sigma())
        errors.append(np.abs(found - truth))
        cells = [
            f"{f:.1f} ± {s:.1f} ({t:.1f})" for f, s, t in zip(found, sigma, truth, strict=True)
        ]
        mode = ", ".join(f"{value:.1f}" for value in np.degrees(modal(beliefs)))
        lines.append(f"| {name} | {len(cases)} | {' | '.join(cells)} | {mode} |")
    medians = np.median(errors, axis=0)
    lines.append("| median error | | " + " | ".join(f"{value:.1f}" for value in medians) + " | |")
    return lines


def _hopeless(panoramas: list[Panorama], network: OrientationNetwork) -> list[str]:
    lines = [
        "Pictures that tell nothing: width of the 95 % interval, degrees.",
        "",
        "| picture | roll | tilt | vertical field of view |",
        "| --- | ---: | ---: | ---: |",
    ]
    for name, picture in hopeless(panoramas):
        belief = network.belief(picture)
        ends = np.degrees([belief.interval(axis) for axis in range(3)])
        lines.append(f"| {name} | " + " | ".join(f"{b - a:.0f}" for a, b in ends) + " |")
    return lines


def fitted_powers(data: Path, network: OrientationNetwork) -> dict[str, float]:
    """Exponents with the best log score on the validation panoramas."""
    cases = list(held_out(read_panoramas(data / "panoramas", "validation"), SEED))
    cases += list(
        degraded_like_training(read_panoramas(data / "panoramas", "validation"), SEED, len(cases))
    )
    found = {}
    raw: dict[str, Reader] = {
        "power": lambda picture: network.belief(picture).tempered(1 / network.power),
        "field power": lambda picture: field_belief(network.outputs(picture)[0], 1.0),
        "line power": lambda picture: Belief.normalised(line_log_likelihood(picture)),
    }
    for name, read in raw.items():
        beliefs = [read(case.picture_bgr) for case in cases]
        powers = np.geomspace(0.01, 2.0, 40)
        scores = [
            np.mean(
                [
                    belief.tempered(power).log_density_at(*case.truth_rad)
                    for belief, case in zip(beliefs, cases, strict=True)
                ]
            )
            for power in powers
        ]
        found[name] = round(float(powers[int(np.argmax(scores))]), 3)
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--network", type=Path, default=None, help="default: the packaged one")
    parser.add_argument("--fit", action="store_true", help="fit the exponents instead")
    parser.add_argument("--write", type=Path, default=None, help="model card to renew")
    args = parser.parse_args()
    network = OrientationNetwork(args.network.read_bytes() if args.network else None)
    if args.fit:
        print(json.dumps(fitted_powers(args.data, network)))  # noqa: T201
        return
    text = measured(args.data, network)
    if args.write is None:
        print(text)  # noqa: T201
        return
    card = args.write.read_text()
    begin, end = "<!-- measured -->", "<!-- end -->"
    before, rest = card.split(begin)
    args.write.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}")


if __name__ == "__main__":
    main()
