"""Train the tail of a packaged network behind stored features: ``python -m training.tail``.

Where a GPU or hours of a processor's cores are missing, the features of a packaged network's first
blocks are kept as they are, and worked out once per picture; the last blocks and both heads, half
of all weights, learn from the store in minutes. The store grows part by part and may be cut short.

    python -m training.tail --panoramas DIR --start network.onnx --store DIR --out checkpoint.pt
"""

import argparse
import json
import math
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from training.loss import WEIGHTS, losses
from training.model import STRIDE_16, OrientationNet
from training.packaged import load_packaged
from training.panoramas import Panorama, read_panoramas
from training.samples import Truth, sample
from training.streets import street_panorama

PART = 256
"""Pictures in one file of the store."""
_PARTS = {"train": 60, "validation": 4}
_SCENES_FIRST = 24
_FIRST_SCENE = {"train": 6 * 10**6, "validation": 10**6}
_PEAK_RATES = (1.5e-4, 3e-4)
"""Of the backbone's last blocks and of what follows them; chosen by hand."""
_BATCH = 32
_EMA = 0.995


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--panoramas", type=Path, required=True, help="folder with SOURCES.csv")
    parser.add_argument("--start", type=Path, required=True, help="a packaged network (.onnx)")
    parser.add_argument("--store", type=Path, required=True, help="folder for the features")
    parser.add_argument("--parts", type=int, default=_PARTS["train"], help=f"of {PART} pictures")
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--out", type=Path, required=True, help="checkpoint for training.export")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    args.store.mkdir(parents=True, exist_ok=True)
    net = load_packaged(args.start)
    for split in ("validation", "train"):
        parts = args.parts if split == "train" else _PARTS[split]
        fill(args.store, split, parts, net, read_panoramas(args.panoramas, split))
    if args.epochs:
        train(net, args.store, args.epochs, args.out)


def fill(
    store: Path, split: str, parts: int, net: OrientationNet, photographs: list[Panorama]
) -> None:
    """Add the parts that are missing, with two new scenes each."""
    backdrops = [panorama for panorama in photographs if panorama.outdoors]
    streets: list[Panorama] = []
    for part in range(parts):
        path = store / f"{split}_{part}.npz"
        if path.exists():
            continue
        while len(streets) < _SCENES_FIRST + 2 * part:
            streets.append(_scene(_FIRST_SCENE[split] + len(streets), backdrops, store))
        shown = [
            sample(np.random.default_rng([77, _FIRST_SCENE[split], part, n]), photographs, streets)
            for n in range(PART)
        ]
        fine = _features(net, [picture for picture, _ in shown])
        partial = path.with_suffix(".part.npz")
        np.savez(partial, fine=fine, **_targets([truth for _, truth in shown]))
        partial.replace(path)


def _scene(number: int, backdrops: list[Panorama], store: Path) -> Panorama:
    """Drawn once, and kept beside the store."""
    path = store / f"scene_{number}.png"
    if not path.exists():
        cv2.imwrite(str(path), street_panorama(number, backdrops).levels[0])
    return Panorama.of(f"street-{number}", cv2.imread(str(path)))


def _features(net: OrientationNet, pictures: list[np.ndarray]) -> np.ndarray:
    """What the tail is shown, (n, 96, 9, 12) in half precision."""
    out = []
    net.eval()
    with torch.inference_mode():
        for first in range(0, len(pictures), 32):
            batch = np.array(pictures[first : first + 32])[..., ::-1].transpose(0, 3, 1, 2)
            rgb = torch.from_numpy(batch.astype(np.float32))
            out.append(net.features[:STRIDE_16]((rgb - net.mean) / net.spread).half().numpy())
    return np.concatenate(out)


def _targets(truths: list[Truth]) -> dict[str, np.ndarray]:
    poses = [[t.view.roll_rad, t.view.tilt_rad, t.view.vfov_rad] for t in truths]
    return {
        "pose": np.array(poses, np.float32),
        "up_uv": np.array([t.up_uv.transpose(2, 0, 1) for t in truths], np.float32),
        "latitude": np.array([t.latitude_rad for t in truths], np.float32),
        "hopeless": np.array([t.hopeless for t in truths]),
    }


def _read(store: Path, split: str) -> dict[str, Tensor]:
    """All parts of a split."""
    found = [np.load(path) for path in sorted(store.glob(f"{split}_*[0-9].npz"))]
    return {name: torch.from_numpy(np.concatenate([f[name] for f in found])) for name in found[0]}


def train(net: OrientationNet, store: Path, epochs: int, out: Path) -> None:
    """Keep the epoch that is best on the held-out features."""
    torch.manual_seed(0)
    shown, held_out = _read(store, "train"), _read(store, "validation")
    net.features[:STRIDE_16].requires_grad_(requires_grad=False)
    blocks = list(net.features[STRIDE_16:].parameters())
    rest = [p for name, p in net.named_parameters() if not name.startswith("features.")]
    groups = [
        {"params": parameters, "peak": peak}
        for parameters, peak in zip((blocks, rest), _PEAK_RATES, strict=True)
    ]
    optimiser = torch.optim.AdamW(groups, weight_decay=0.02)
    average = {name: value.clone() for name, value in net.state_dict().items()}
    count, step = len(shown["pose"]), 0
    steps = epochs * (count // _BATCH)
    best = _say(0, count, _loss(net, held_out))
    for epoch in range(1, epochs + 1):
        net.train()
        for chosen in torch.randperm(count).split(_BATCH)[: count // _BATCH]:
            done = step / steps
            rate = min(1.0, done / 0.05) * 0.5 * (1 + math.cos(math.pi * done)) + 0.003
            for group in optimiser.param_groups:
                group["lr"] = rate * group["peak"]
            batch = {name: values[chosen] for name, values in shown.items()}
            parts = losses(net.after(batch["fine"].float()), batch)
            optimiser.zero_grad(set_to_none=True)
            sum(WEIGHTS[name] * part for name, part in parts.items()).backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
            optimiser.step()
            step += 1
            _follow(average, net, min(_EMA, step / (step + 20)))
        own = {name: value.clone() for name, value in net.state_dict().items()}
        net.load_state_dict(average)
        found = _say(epoch, count, _loss(net, held_out))
        if found < best:
            best = found
            torch.save({"average": net.state_dict(), "step": step}, out)
        net.load_state_dict(own)


def _follow(average: dict[str, Tensor], net: OrientationNet, keep: float) -> None:
    for name, value in net.state_dict().items():
        average[name].lerp_(value, 1 - keep)


def _loss(net: OrientationNet, held_out: dict[str, Tensor]) -> dict[str, float]:
    net.eval()
    with torch.no_grad():
        parts = losses(net.after(held_out["fine"].float()), held_out)
    return {name: round(float(part), 4) for name, part in parts.items()}


def _say(epoch: int, pictures: int, parts: dict[str, float]) -> float:
    """Print a line of the learning curve; the bins' loss, which chooses the epoch."""
    bins = WEIGHTS["pose"] * parts["pose"] + WEIGHTS["roll"] * parts["roll"]
    line = {"epoch": epoch, "pictures": pictures, "validation": parts, "bins": round(bins, 4)}
    print(json.dumps(line), flush=True)  # noqa: T201
    return bins


if __name__ == "__main__":
    main()
