"""Samples as torch wants them."""

from collections.abc import Sequence

import numpy as np
import torch
from torch.utils.data import Dataset

from training.panoramas import Panorama
from training.samples import sample


class Samples(Dataset):
    """Samples ``[0, count)`` of an epoch, as tensors."""

    def __init__(
        self,
        seed: Sequence[int],
        count: int,
        photographs: Sequence[Panorama],
        streets: Sequence[Panorama],
    ):
        self.seed, self.count = tuple(seed), count
        self.photographs, self.streets = photographs, streets

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        rng = np.random.default_rng([*self.seed, index])
        picture, truth = sample(rng, self.photographs, self.streets)
        view = truth.view
        pose = np.array([view.roll_rad, view.tilt_rad, view.vfov_rad], np.float32)
        latitude = truth.latitude_rad
        if truth.hopeless:
            latitude = np.full_like(latitude, rng.uniform(-1.2, 0.6))
        return {
            "picture": torch.from_numpy(picture[..., ::-1].transpose(2, 0, 1).copy()),
            "pose": torch.from_numpy(pose),
            "up_uv": torch.from_numpy(truth.up_uv.transpose(2, 0, 1).astype(np.float32)),
            "latitude": torch.from_numpy(latitude.astype(np.float32)),
            "hopeless": torch.tensor(truth.hopeless),
        }
