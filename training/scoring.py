"""Errors of the network's distributions on pictures with known cameras."""

import numpy as np
import torch
from torch import Tensor

from scene4d.perception.orientation.grid import ROLL_RAD, TILT_RAD, VFOV_RAD


def _means(outputs: tuple[Tensor, Tensor, Tensor]) -> np.ndarray:
    """Posterior means of roll, tilt and vertical field of view of the global head, (b, 3)."""
    _, roll, pose = outputs
    roll_p = torch.softmax(roll.double(), dim=1).cpu().numpy()
    pose_p = torch.softmax(pose.double().flatten(1), dim=1).reshape(pose.shape).cpu().numpy()
    vfov = np.exp(pose_p.sum(axis=1) @ np.log(VFOV_RAD))
    return np.column_stack([roll_p @ ROLL_RAD, pose_p.sum(axis=2) @ TILT_RAD, vfov])


def median_errors(
    outputs: list[tuple[Tensor, Tensor, Tensor]], batches: list[dict[str, Tensor]]
) -> dict[str, float]:
    """Median absolute errors in degrees over the pictures that tell something."""
    found = np.vstack([_means(output) for output in outputs])
    truth = np.vstack([batch["pose"].cpu().numpy() for batch in batches])
    told = ~np.concatenate([batch["hopeless"].cpu().numpy() for batch in batches])
    errors = np.degrees(np.abs(found - truth))[told]
    names = ("roll_deg", "tilt_deg", "vfov_deg")
    return {name: round(float(np.median(errors[:, n])), 3) for n, name in enumerate(names)}
