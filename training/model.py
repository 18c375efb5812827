"""The network: MobileNetV2's features (Sandler et al. 2018) and two heads.

``dense``: per cell of 16 pixels the image's up direction and the latitude, each with a confidence.
``global``: probability over the grid of (tilt, field of view), and over roll.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from scene4d.perception.orientation.grid import SHAPE
from training.panoramas import CELLS

_STAGES = (  # expansion, channels, blocks, stride: table 2 of the paper
    (1, 16, 1, 1),
    (6, 24, 2, 2),
    (6, 32, 3, 2),
    (6, 64, 4, 2),
    (6, 96, 3, 1),
    (6, 160, 3, 2),
    (6, 320, 1, 1),
)
_STEM = 4
"""So many of the first layers keep ImageNet's weights: edges are edges, and their gradients cost
half of the time of training on a CPU."""
STRIDE_16 = 14  # features[:14] end where an image has a sixteenth of its width


def _conv(inward: int, outward: int, size: int = 3, stride: int = 1, groups: int = 1):
    return nn.Sequential(
        nn.Conv2d(inward, outward, size, stride, (size - 1) // 2, groups=groups, bias=False),
        nn.BatchNorm2d(outward),
        nn.ReLU6(inplace=True),
    )


class InvertedResidual(nn.Module):
    """Expansion, depthwise filter, projection; added to its input where shapes agree."""

    def __init__(self, inward: int, outward: int, stride: int, expansion: int):
        super().__init__()
        hidden = inward * expansion
        self.adds = stride == 1 and inward == outward
        layers = [] if expansion == 1 else [_conv(inward, hidden, 1)]
        layers += [
            _conv(hidden, hidden, 3, stride, hidden),
            nn.Conv2d(hidden, outward, 1, bias=False),
            nn.BatchNorm2d(outward),
        ]
        self.conv = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        """(b, inward, h, w) to (b, outward, h / stride, w / stride)."""
        return x + self.conv(x) if self.adds else self.conv(x)


def backbone() -> nn.Sequential:
    """Features of MobileNetV2, named as in the published weights."""
    layers: list[nn.Module] = [_conv(3, 32, 3, 2)]
    inward = 32
    for expansion, channels, blocks, stride in _STAGES:
        for block in range(blocks):
            layers.append(
                InvertedResidual(inward, channels, stride if block == 0 else 1, expansion)
            )
            inward = channels
    return nn.Sequential(*layers)


class OrientationNet(nn.Module):
    """Pictures (b, 3, 144, 192), RGB, 0 to 255, to the outputs of both heads."""

    def __init__(self, width: int = 128):
        super().__init__()
        self.register_buffer("mean", torch.tensor([123.675, 116.28, 103.53]).view(1, 3, 1, 1))
        self.register_buffer("spread", torch.tensor([58.395, 57.12, 57.375]).view(1, 3, 1, 1))
        self.features = backbone()
        self.features[:_STEM].requires_grad_(requires_grad=False)
        self.coarse = nn.Sequential(nn.Conv2d(320, width, 1, bias=False), nn.BatchNorm2d(width))
        self.fine = nn.Sequential(nn.Conv2d(96, width, 1, bias=False), nn.BatchNorm2d(width))
        self.mix = nn.Sequential(
            nn.ReLU(), _conv(width, width, 3, 1, width), _conv(width, width, 1)
        )
        self.dense = nn.Conv2d(width, 4, 1)
        self.squeeze = _conv(width + 4, 48, 3, 2)
        cells = 48 * ((CELLS[0] + 1) // 2) * ((CELLS[1] + 1) // 2)
        self.trunk = nn.Sequential(nn.Dropout(0.1), nn.Linear(cells, 256), nn.ReLU())
        self.pose = nn.Linear(256, SHAPE[1] * SHAPE[2])
        self.roll = nn.Linear(256, SHAPE[0])

    def train(self, mode: bool = True) -> "OrientationNet":
        """As everywhere, but that the first layers keep their statistics too."""
        super().train(mode)
        self.features[:_STEM].eval()
        return self

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``dense`` (b, 4, 9, 12), ``roll`` (b, 33) and ``pose`` (b, 37, 21), the last two logits.

        ``dense``: a vector whose direction is up in the image and whose length is the
        concentration of a von Mises distribution; latitude in radians; log of its Laplace spread.
        """
        with torch.no_grad():
            stem = self.features[:_STEM]((x - self.mean) / self.spread)
        return self.after(self.features[_STEM:STRIDE_16](stem))

    def after(self, fine: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As :meth:`forward`, from the features (b, 96, 9, 12) of the first blocks."""
        coarse = self.coarse(self.features[STRIDE_16:](fine))
        raised = functional.interpolate(
            coarse, size=(CELLS[1], CELLS[0]), mode="bilinear", align_corners=False
        )
        mixed = self.mix(self.fine(fine) + raised)
        dense = self.dense(mixed)
        trunk = self.trunk(self.squeeze(torch.cat([mixed, dense], dim=1)).flatten(1))
        return dense, self.roll(trunk), self.pose(trunk).unflatten(1, SHAPE[1:])


def load_backbone(net: OrientationNet, weights: dict[str, Tensor]) -> None:
    """Start from ImageNet's weights; raises :class:`KeyError` where a layer is missing."""
    own = net.features.state_dict()
    net.features.load_state_dict({name: weights[f"features.{name}"] for name in own})
