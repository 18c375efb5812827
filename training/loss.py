"""What the two heads are taught: likelihoods, so that their confidences mean something."""

import torch
from torch import Tensor
from torch.nn import functional

from scene4d.perception.orientation.grid import ROLL_RAD, TILT_RAD, VFOV_RAD

WEIGHTS = {"pose": 1.0, "roll": 0.6, "up": 0.7, "latitude": 0.7}
"""Share of every part in the loss."""
_BLUR_CELLS = 0.7
_LOG_SPREAD = (-5.0, 2.0)


def _axis(values_rad, *, logarithmic: bool = False) -> tuple[float, float, int]:
    nodes = torch.tensor(values_rad, dtype=torch.float64)
    nodes = nodes.log() if logarithmic else nodes
    return float(nodes[0]), float(nodes[1] - nodes[0]), len(nodes)


_ROLL, _TILT = _axis(ROLL_RAD), _axis(TILT_RAD)
_LOG_VFOV = _axis(VFOV_RAD, logarithmic=True)


def _soft(value: Tensor, axis: tuple[float, float, int]) -> Tensor:
    """A blurred one at each value's place on its axis, (b, cells)."""
    first, step, count = axis
    place = (value - first) / step
    cells = torch.arange(count, device=value.device)
    weight = torch.exp(-0.5 * ((cells - place[:, None]) / _BLUR_CELLS) ** 2)
    return weight / weight.sum(dim=1, keepdim=True)


def losses(outputs: tuple[Tensor, Tensor, Tensor], batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """Mean of every part over a batch; a hopeless picture asks for an even distribution."""
    dense, roll, pose = (output.float() for output in outputs)
    return bin_losses(roll, pose, batch) | {
        "up": _von_mises(dense[:, :2], batch["up_uv"], batch["hopeless"]),
        "latitude": _laplace(dense[:, 2], dense[:, 3], batch["latitude"]),
    }


def bin_losses(roll: Tensor, pose: Tensor, batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """Of the bins alone."""
    hopeless = batch["hopeless"]
    even = hopeless[:, None]
    wanted_roll = torch.where(even, 1 / roll.shape[1], _soft(batch["pose"][:, 0], _ROLL))
    tilt = torch.where(even, 1 / _TILT[2], _soft(batch["pose"][:, 1], _TILT))
    vfov = torch.where(even, 1 / _LOG_VFOV[2], _soft(batch["pose"][:, 2].log(), _LOG_VFOV))
    wanted_pose = (tilt[:, :, None] * vfov[:, None, :]).flatten(1)
    return {
        "pose": functional.cross_entropy(pose.flatten(1), wanted_pose),
        "roll": functional.cross_entropy(roll, wanted_roll),
    }


def _von_mises(vector: Tensor, up_uv: Tensor, hopeless: Tensor) -> Tensor:
    """Negative log-likelihood of a direction under a vector of natural parameters (b, 2, h, w)."""
    length = vector.square().sum(dim=1).add(1e-6).sqrt()
    log_normaliser = torch.special.i0e(length).log() + length
    agreement = (vector * up_uv).sum(dim=1) * (~hopeless)[:, None, None]
    return (log_normaliser - agreement).mean()


def _laplace(mean: Tensor, log_spread: Tensor, truth: Tensor) -> Tensor:
    log_spread = log_spread.clamp(*_LOG_SPREAD)
    return ((truth - mean).abs() * torch.exp(-log_spread) + log_spread).mean()
