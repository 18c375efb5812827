"""Start from the weights of a packaged network instead of ImageNet's.

An exported network has its batch normalisations folded into the convolutions before them, so what
goes on from it has none: each convolution has a bias of its own.
"""

import itertools
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from training.model import OrientationNet
from training.panoramas import CROP_SIZE

_TOLERANCE = 1e-4


def folded(net: OrientationNet) -> OrientationNet:
    """The same network with a bias in the place of every batch normalisation."""
    for parent in list(net.modules()):
        children = list(parent.named_children())
        for (_, layer), (after, norm) in itertools.pairwise(children):
            if isinstance(norm, nn.BatchNorm2d) and isinstance(layer, nn.Conv2d):
                layer.bias = nn.Parameter(
                    torch.zeros(layer.out_channels), requires_grad=layer.weight.requires_grad
                )
                setattr(parent, after, nn.Identity())
    return net


def load_packaged(path: Path) -> OrientationNet:
    """The network of an .onnx file, ready to go on learning.

    Raises :class:`ValueError` where the file holds another network, or torch and ONNX disagree.
    """
    net = folded(OrientationNet()).eval()
    layers = _in_order(net)
    weights = _weights(path)
    if [w.shape for w, _ in weights] != [layer.weight.shape for layer in layers]:
        raise ValueError(f"{path}: not the layers of training.model")
    with torch.no_grad():
        for layer, (weight, bias) in zip(layers, weights, strict=True):
            layer.weight.copy_(weight)
            layer.bias.copy_(bias)
        shown = torch.rand(2, 3, CROP_SIZE[1], CROP_SIZE[0]) * 255
        expected = net(shown)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    for ours, theirs in zip(expected, session.run(None, {"picture": shown.numpy()}), strict=True):
        if float(np.abs(ours.numpy() - theirs).max()) > _TOLERANCE:
            raise ValueError(f"{path}: torch and ONNX disagree about a picture")
    return net


def _in_order(net: OrientationNet) -> list[nn.Conv2d | nn.Linear]:
    """Layers with weights, in the order in which they are used; roll comes before pose."""
    used: list = []
    hooks = [
        layer.register_forward_hook(lambda layer, _, __: used.append(layer))
        for layer in net.modules()
        if isinstance(layer, nn.Conv2d | nn.Linear)
    ]
    with torch.no_grad():
        net(torch.zeros(1, 3, CROP_SIZE[1], CROP_SIZE[0]))
    for hook in hooks:
        hook.remove()
    return used


def _weights(path: Path) -> list[tuple[Tensor, Tensor]]:
    """Weight and bias of every layer, in the order of the file, in single precision."""
    graph = onnx.load(str(path)).graph
    stored = {value.name: numpy_helper.to_array(value) for value in graph.initializer}
    values = dict(stored)
    for node in graph.node:
        if node.op_type == "Cast" and node.input[0] in stored:
            values[node.output[0]] = stored[node.input[0]].astype(np.float32)
        if node.op_type == "DequantizeLinear":
            small, scale = (stored[name] for name in node.input[:2])
            values[node.output[0]] = small.astype(np.float32) * scale[:, None]
    return [
        (torch.tensor(values[node.input[1]]), torch.tensor(values[node.input[2]]))
        for node in graph.node
        if node.op_type in ("Conv", "Gemm")
    ]
