"""Draw what the network learns from, and how it learned: ``python -m training.figures``.

python -m training.figures --panoramas DIR --curve curve.jsonl --out docs/images
"""

import argparse
import json
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from training.panoramas import CELLS, read_panoramas
from training.samples import Truth, sample
from training.streets import street_panorama

mpl.use("agg")
import matplotlib.pyplot as plt

COLUMNS, ROWS = 6, 4
STREETS = 6
_UP, _DOWN = (60, 220, 60), (230, 60, 230)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--panoramas", type=Path, required=True)
    parser.add_argument("--curve", type=Path, required=True, help="curve.jsonl of the training")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    cv2.imwrite(str(args.out / "orientation_samples.jpg"), samples_sheet(args.panoramas))
    learning_curve(args.curve, args.out / "orientation_learning.png")


def samples_sheet(folder: Path) -> np.ndarray:
    """Samples with their cameras: arrows point up, green above the horizon and magenta below."""
    photographs = read_panoramas(folder, "validation")
    backdrops = [panorama for panorama in photographs if panorama.outdoors]
    streets = [street_panorama(10**6 + n, backdrops) for n in range(STREETS)]
    tiles = []
    for index in range(COLUMNS * ROWS):
        picture, truth = sample(np.random.default_rng([42, index]), photographs, streets)
        tiles.append(_with_fields(picture, truth))
    rows = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
    return np.vstack(rows)


def _with_fields(picture: np.ndarray, truth: Truth) -> np.ndarray:
    drawn = cv2.resize(picture, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_CUBIC)
    for row in range(1, CELLS[1], 3):
        for column in range(1, CELLS[0], 3):
            foot = (np.array([column, row]) + 0.5) * 24
            head = foot + 16 * truth.up_uv[row, column]
            colour = _UP if truth.latitude_rad[row, column] > 0 else _DOWN
            ends = [tuple(np.round(end).astype(int).tolist()) for end in (foot, head)]
            if not truth.hopeless:
                cv2.arrowedLine(drawn, *ends, colour, 1, cv2.LINE_AA, tipLength=0.35)
    view = truth.view
    text = "tells nothing" if truth.hopeless else (
        f"vfov {np.degrees(view.vfov_rad):.0f}  tilt {np.degrees(view.tilt_rad):.0f}  "
        f"roll {np.degrees(view.roll_rad):.0f}"
    )  # fmt: skip
    cv2.rectangle(drawn, (0, 0), (drawn.shape[1], 15), (0, 0, 0), -1)
    cv2.putText(drawn, text, (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255,) * 3, 1, cv2.LINE_AA)
    return drawn


def learning_curve(curve: Path, out: Path) -> None:
    """Median errors on the validation panoramas over the time of training."""
    lines = [json.loads(line) for line in curve.read_text().splitlines()]
    minutes = [line["minutes"] for line in lines]
    figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
    for name, label in (
        ("vfov_deg", "vertical field of view"), ("tilt_deg", "tilt"), ("roll_deg", "roll"),
    ):  # fmt: skip
        axes.plot(minutes, [line["validation"][name] for line in lines], label=label)
    axes.set(xlabel="minutes of training on 2 CPU cores", ylabel="median error, degrees", ylim=0)
    axes.grid(visible=True, alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(out, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    main()
