"""Train the orientation network: ``python -m training.train --panoramas DIR --backbone FILE``.

With ``--start FILE`` a packaged network goes on learning instead. The schedule follows the clock
(``--minutes``), so that a busy machine ends in time; training goes on from its checkpoint after a
kill. The learning curve is ``curve.jsonl`` beside the checkpoint.
"""

import argparse
import json
import math
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader

from training.data import Samples
from training.loss import WEIGHTS, losses
from training.model import OrientationNet, load_backbone
from training.packaged import load_packaged
from training.panoramas import Panorama, read_panoramas
from training.scoring import median_errors
from training.streets import street_panorama

EPOCH_SAMPLES = 8000
STREETS = 96
"""Invented scenes in use at a time."""
FRESH_STREETS = 12
"""How many of them are replaced every epoch."""
VALIDATION_STREETS = range(10**6, 10**6 + 24)
VALIDATION_SAMPLES = 768
_EMA = 0.998
_WARM_UP = 0.03
_PEAK_RATES = (6e-4, 1.5e-3)
"""Of the pretrained layers and of the new ones."""
_GO_ON = 0.25
"""Share of these rates where a packaged network goes on; chosen by hand."""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--panoramas", type=Path, required=True, help="folder with SOURCES.csv")
    start = parser.add_mutually_exclusive_group(required=True)
    start.add_argument("--backbone", type=Path, help="MobileNetV2 weights (.pth)")
    start.add_argument("--start", type=Path, help="a packaged network (.onnx) to go on from")
    parser.add_argument("--out", type=Path, default=Path("out/orientation"))
    parser.add_argument("--minutes", type=float, default=150.0)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    train(parser.parse_args())


class Shelf:
    """The invented scenes in use, drawn by a pool of processes."""

    def __init__(self, backdrops: list[Panorama], workers: int):
        self.drawn: dict[int, Panorama] = {}
        self.backdrops, self.workers = backdrops, workers

    def scenes(self, seeds: range) -> list[Panorama]:
        """Those of the seeds; what is no longer asked for is thrown away."""
        missing = [seed for seed in seeds if seed not in self.drawn]
        kept = {seed: scene for seed, scene in self.drawn.items() if seed in seeds}
        # Forked, so that the backdrops are shared and not copied.
        fork = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(self.workers, fork, _start_drawing, (self.backdrops,)) as pool:
            kept.update(zip(missing, pool.map(_draw, missing), strict=True))
        self.drawn = kept
        return [kept[seed] for seed in seeds]


_BACKDROPS: list[Panorama] = []


def _start_drawing(backdrops: list[Panorama]) -> None:
    _BACKDROPS[:] = backdrops
    _one_thread()


def _draw(seed: int) -> Panorama:
    return street_panorama(seed, _BACKDROPS)


def _one_thread(_: int = 0) -> None:
    cv2.setNumThreads(1)
    torch.set_num_threads(1)


class Training:
    """Network, its running average, optimiser, and how far they are."""

    def __init__(self, args: argparse.Namespace, device: torch.device):
        torch.manual_seed(args.seed)
        self.device = device
        if args.start:
            self.net, share = load_packaged(args.start), _GO_ON
        else:
            self.net, share = OrientationNet(), 1.0
            weights = torch.load(args.backbone, map_location="cpu", weights_only=True)
            load_backbone(self.net, weights)
        self.net.to(device, memory_format=torch.channels_last)
        pretrained = [p for p in self.net.features.parameters() if p.requires_grad]
        features = {id(p) for p in self.net.features.parameters()}
        new = [p for p in self.net.parameters() if id(p) not in features]
        groups = [
            {"params": parameters, "peak": share * peak}
            for parameters, peak in zip((pretrained, new), _PEAK_RATES, strict=True)
        ]
        self.optimiser = torch.optim.AdamW(groups, lr=1e-3, weight_decay=0.01)
        self.average = {name: value.clone() for name, value in self.net.state_dict().items()}
        self.epoch, self.step, self.seconds = 0, 0, 0.0

    def save(self, path: Path) -> None:
        """Write whole or not at all."""
        names = ("epoch", "step", "seconds", "average")
        state = {name: getattr(self, name) for name in names}
        state["net"], state["optimiser"] = self.net.state_dict(), self.optimiser.state_dict()
        partial_path = path.with_suffix(".part")
        torch.save(state, partial_path)
        os.replace(partial_path, path)  # noqa: PTH105

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        state = torch.load(path, map_location=self.device, weights_only=True)
        self.net.load_state_dict(state.pop("net"))
        self.optimiser.load_state_dict(state.pop("optimiser"))
        for name, value in state.items():
            setattr(self, name, value)

    def learn(self, batch: dict[str, torch.Tensor], done: float) -> dict[str, float]:
        """One step; ``done`` is the share of the time that has passed."""
        rate = min(1.0, done / _WARM_UP) * 0.5 * (1 + math.cos(math.pi * min(done, 1.0))) + 0.003
        for group in self.optimiser.param_groups:
            group["lr"] = rate * group["peak"]
        self.net.train()
        parts = losses(self.outputs(batch), batch)
        total = sum(WEIGHTS[name] * part for name, part in parts.items())
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimiser.step()
        self.step += 1
        keep = min(_EMA, self.step / (self.step + 20))
        for name, value in self.net.state_dict().items():
            if value.dtype.is_floating_point:
                self.average[name].lerp_(value, 1 - keep)
        return {name: float(part.detach()) for name, part in parts.items()}

    def outputs(self, batch: dict[str, torch.Tensor]):
        """The network's, in half precision where the machine has it."""
        picture = batch["picture"].float().contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, dtype=torch.bfloat16):
            return self.net(picture)

    def validate(self, batches: list[dict[str, torch.Tensor]]) -> dict[str, float]:
        """Losses and median errors of the averaged network."""
        own = {name: value.clone() for name, value in self.net.state_dict().items()}
        self.net.load_state_dict(self.average)
        self.net.eval()
        with torch.no_grad():
            outputs = [self.outputs(batch) for batch in batches]
            parts = [losses(output, batch) for output, batch in zip(outputs, batches, strict=True)]
        self.net.load_state_dict(own)
        found = {name: float(np.mean([part[name] for part in parts])) for name in parts[0]}
        return found | median_errors(outputs, batches)


def train(args: argparse.Namespace) -> None:
    """Until the time is up."""
    cv2.setNumThreads(1)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    args.out.mkdir(parents=True, exist_ok=True)
    training = Training(args, device)
    checkpoint = args.out / "checkpoint.pt"
    if checkpoint.exists():
        training.load(checkpoint)
    photographs = read_panoramas(args.panoramas, "train")
    shelf = Shelf([panorama for panorama in photographs if panorama.outdoors], args.workers)
    held_out = _validation(args, device)
    began = time.monotonic() - training.seconds
    while training.seconds < 60 * args.minutes:
        first = FRESH_STREETS * training.epoch
        streets = shelf.scenes(range(first, first + STREETS))
        samples = Samples((args.seed, training.epoch), EPOCH_SAMPLES, photographs, streets)
        sums: dict[str, list[float]] = {}
        for batch in _batches(samples, args, device):
            training.seconds = time.monotonic() - began
            done = training.seconds / (60 * args.minutes)
            if done >= 1:
                break
            for name, value in training.learn(batch, done).items():
                sums.setdefault(name, []).append(value)
        training.epoch += 1
        training.save(checkpoint)
        line = {
            "epoch": training.epoch,
            "step": training.step,
            "minutes": round(training.seconds / 60, 2),
            "train": {name: round(float(np.mean(values)), 4) for name, values in sums.items()},
            "validation": training.validate(held_out),
        }
        with (args.out / "curve.jsonl").open("a") as file:
            file.write(json.dumps(line) + "\n")
        print(json.dumps(line), flush=True)  # noqa: T201


def _validation(args: argparse.Namespace, device: torch.device) -> list[dict[str, torch.Tensor]]:
    photographs = read_panoramas(args.panoramas, "validation")
    backdrops = [panorama for panorama in photographs if panorama.outdoors]
    streets = Shelf(backdrops, args.workers).scenes(VALIDATION_STREETS)
    samples = Samples((args.seed, 10**6), VALIDATION_SAMPLES, photographs, streets)
    return list(_batches(samples, args, device))


def _batches(samples: Samples, args: argparse.Namespace, device: torch.device):
    loader = DataLoader(
        samples,
        batch_size=args.batch,
        num_workers=args.workers,
        worker_init_fn=_one_thread,
        prefetch_factor=4 if args.workers else None,
    )
    for batch in loader:
        yield {name: value.to(device, non_blocking=True) for name, value in batch.items()}


if __name__ == "__main__":
    main()
