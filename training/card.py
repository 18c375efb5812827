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

from scene4d.perception.orientation import Belief, OrientationNetwork, PoseReader, fused, modal
from scene4d.perception.orientation._lines import line_log_likelihood
from training.cases import (
    HILLSIDES,
    Case,
    blurred,
    degraded_like_training,
    drawn_slopes,
    held_out,
    hopeless,
    real_cameras,
    steep,
    turned,
    wooded_slopes,
)
from training.fields import field_belief
from training.panoramas import SPLITS, Panorama, read_panoramas

SEED = 20
TUNED = ("gkjohnson", "happy358")
"""The constants of the lines were chosen on crops of panoramas of these names, of every split."""
PRODUCT = "**bins and lines: the product**"
Reader = Callable[[np.ndarray], Belief]
WIDE_DEG = (15.0, 25.0)
"""Widths of 95 % intervals of tilt and field of view, above which an answer claims little."""
FIELD_POWER = 0.019
"""Exponent of the dense head's likelihood, whose cells repeat one another; fitted likewise."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Median absolute errors in degrees (roll, tilt, vfov), coverage of 95 %, and log score."""

    median_deg: np.ndarray
    coverage: np.ndarray
    log_score: float
    count: int


def score(cases: Iterable[Case], read: Reader) -> Scores:
    """Posterior means against the truth, and how often 95 % intervals hold it."""
    errors, inside, logs = [], [], []
    for case in cases:
        belief = read(case.picture_bgr)
        errors.append(np.abs(belief.mean() - case.truth_rad))
        ends = np.array([belief.interval(axis) for axis in range(3)])
        inside.append((ends[:, 0] <= case.truth_rad) & (case.truth_rad <= ends[:, 1]))
        logs.append(belief.log_density_at(*case.truth_rad))
    return Scores(
        np.degrees(np.median(errors, axis=0)),
        np.mean(inside, axis=0),
        float(np.mean(logs)),
        len(errors),
    )


def readers(network: OrientationNetwork) -> dict[str, Reader]:
    """A guess that knows the ranges, the classical baseline, both designs, and the product."""
    middle = (0.0, np.radians(20), np.log(np.radians(37.4)))
    guess = Belief.gaussian(middle, (np.radians(5), np.radians(17), 0.36))  # what held_out draws
    product = PoseReader(network)

    def dense(picture: np.ndarray) -> Belief:
        return field_belief(network.outputs(picture)[0], FIELD_POWER)

    def lines(picture: np.ndarray) -> Belief:
        return Belief.normalised(line_log_likelihood(picture))

    return {
        "best constant guess": lambda picture: guess,
        "lines and vanishing points": lines,
        "network, dense head": dense,
        "network, bins": network.belief,
        PRODUCT: product.belief,
    }


def _row(name: str, scores: Scores) -> str:
    roll, tilt, vfov = scores.median_deg
    held = " / ".join(f"{share:.0%}" for share in scores.coverage)
    return f"| {name} | {roll:.2f} | {tilt:.2f} | {vfov:.2f} | {held} | {scores.log_score:.2f} |"


_HEAD = (
    "| | roll ° | tilt ° | vertical field of view ° | in the 95 % interval | log score |\n"
    "| --- | ---: | ---: | ---: | ---: | ---: |"
)


def measured(data: Path, network: OrientationNetwork, split: str = "test") -> str:
    """All tables, in Markdown, of the panoramas of one split."""
    test, product = read_panoramas(data / "panoramas", split), PoseReader(network)
    cases = list(held_out(test, SEED))
    lines = [f"{len(cases)} crops of {len(test)} panoramas, tilt -10 to 50°.", "", _HEAD]
    told = {id(case.picture_bgr): product.belief(case.picture_bgr) for case in cases}
    for name, read in (readers(network) | {PRODUCT: lambda picture: told[id(picture)]}).items():
        lines.append(_row(name, score(cases, read)))
    lines += ["", "The product, by the tilt of the crops, and by the place.", "", _HEAD]
    for name, part in _parts(cases, test).items():
        lines.append(_row(f"{name} ({len(part)})", score(part, lambda picture: told[id(picture)])))
    lines += ["", "Other crops: steep ones, and ground that slopes. The product again.", "", _HEAD]
    for name, part in {
        "tilt 40 to 70°": list(steep(test, SEED)),
        "wooded places made to slope, 3-20°": list(wooded_slopes(test, SEED)),
        "drawn streets that slope, 5-20°": list(drawn_slopes(test, SEED)),
    }.items():
        lines.append(_row(f"{name} ({len(part)})", score(part, product.belief)))
    lines += ["", "The same crops made worse, and the network alone.", "", _HEAD]
    for sigma in (1.0, 2.0, 3.0):
        lines.append(_row(f"blurred, σ {sigma:g} px", score(blurred(cases, sigma), network.belief)))
    worse = degraded_like_training(test, SEED, len(cases))
    lines.append(_row("all weathers and ranges of training", score(worse, network.belief)))
    lines += ["", *_real(data, product), "", *_hopeless(test, product)]
    return "\n".join(lines)


def _parts(cases: list[Case], panoramas: list[Panorama]) -> dict[str, list[Case]]:
    indoors = {panorama.name for panorama in panoramas if not panorama.outdoors}
    return {
        "tilt below 0°": [case for case in cases if case.truth_rad[1] < 0],
        "tilt 0 to 40°": [case for case in cases if 0 <= case.truth_rad[1] < np.radians(40)],
        "tilt 40 to 50°": [case for case in cases if case.truth_rad[1] >= np.radians(40)],
        "hillsides": [case for case in cases if case.name in HILLSIDES],
        "panoramas that tuned nothing": [case for case in cases if not case.name.startswith(TUNED)],
        "outdoors": [case for case in cases if case.name not in indoors],
        "indoors": [case for case in cases if case.name in indoors],
    }


def _real(data: Path, reader: PoseReader) -> list[str]:
    lines = [
        "Real fixed cameras, never trained on: found ± σ (true), degrees.",
        "",
        "| camera | frames | roll | tilt | vertical field of view | mode over frames |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    errors = []
    for name, cases in real_cameras(data):
        beliefs = [reader.belief(case.picture_bgr) for case in cases]
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


def _hopeless(panoramas: list[Panorama], reader: PoseReader) -> list[str]:
    lines = [
        "Pictures without information: width of the 95 % interval, degrees.",
        "",
        "| picture | roll | tilt | vertical field of view |",
        "| --- | ---: | ---: | ---: |",
    ]
    for name, picture in hopeless(panoramas):
        lines.append(f"| {name} | {_cells(_widths_deg(reader.belief(picture)))} |")
    sides = list(turned(panoramas, SEED))
    widths = np.array([_widths_deg(reader.belief(case.picture_bgr)) for case in sides])
    lines.append(f"| median of {len(sides)} turned crops | {_cells(np.median(widths, axis=0))} |")
    lines.append(f"| 5th percentile of these | {_cells(np.percentile(widths, 5, axis=0))} |")
    narrow = ~(widths[:, 1:] > WIDE_DEG).all(axis=1)
    wanted = " and ".join(f"{value:g}°" for value in WIDE_DEG)
    lines += ["", f"Turned crops narrower than {wanted} of tilt and field of view: "
              f"{narrow.mean():.1%}."]  # fmt: skip
    return lines


def _widths_deg(belief: Belief) -> np.ndarray:
    return np.degrees([np.ptp(belief.interval(axis)) for axis in range(3)])


def _cells(values: np.ndarray) -> str:
    return " | ".join(f"{value:.0f}" for value in values)


def fitted_powers(data: Path, network: OrientationNetwork) -> dict[str, float]:
    """Exponents with the best mean log score on the validation panoramas."""
    cases = list(held_out(read_panoramas(data / "panoramas", "validation"), SEED))
    bins = [network.belief(case.picture_bgr).log_p for case in cases]
    lines = [line_log_likelihood(case.picture_bgr) for case in cases]
    dense = [field_belief(network.outputs(case.picture_bgr)[0], 1.0).log_p for case in cases]

    def log_score(*weighted: tuple[float, list[np.ndarray]]) -> float:
        total = 0.0
        for n, case in enumerate(cases):
            log_p = sum(power * log_p[n] for power, log_p in weighted)
            total += Belief.normalised(log_p).log_density_at(*case.truth_rad)
        return total / len(cases)

    steps = np.arange(0.5, 1.21, 0.05)
    scores = {(a, b): log_score((a, bins), (b, lines)) for a in steps for b in steps}
    network_power, line_power = max(scores, key=lambda powers: scores[powers])
    small = np.geomspace(0.005, 0.5, 25)
    field_power = max(small, key=lambda power: log_score((power, dense)))
    names = ("NETWORK_POWER", "LINE_POWER", "FIELD_POWER")
    found = (network_power, line_power, field_power)
    return {name: round(float(value), 3) for name, value in zip(names, found, strict=True)}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--network", type=Path, default=None, help="default: the packaged one")
    parser.add_argument("--split", choices=SPLITS, default="test", help="panoramas to measure on")
    parser.add_argument("--fit", action="store_true", help="fit the exponents instead")
    parser.add_argument("--write", type=Path, default=None, help="model card to renew")
    args = parser.parse_args()
    network = OrientationNetwork(args.network.read_bytes() if args.network else None)
    if args.fit:
        print(json.dumps(fitted_powers(args.data, network)))  # noqa: T201
        return
    text = measured(args.data, network, args.split)
    if args.write is None:
        print(text)  # noqa: T201
        return
    card = args.write.read_text()
    begin, end = "<!-- measured -->", "<!-- end -->"
    before, rest = card.split(begin)
    args.write.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}")


if __name__ == "__main__":
    main()
