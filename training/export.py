"""Write the trained network as ONNX and check it: ``python -m training.export CHECKPOINT``.

Weights are stored in half precision or less and computed in single (:func:`_shrink`).
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import TensorProto, helper, numpy_helper

from training.model import OrientationNet
from training.packaged import folded
from training.panoramas import CROP_SIZE, read_panoramas
from training.prior import attach, trained_tilts

_LARGE = 1024
_TOLERANCE = 0.05


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--panoramas", type=Path, required=True, help="folder with SOURCES.csv")
    parser.add_argument("--out", type=Path, required=True, help="the .onnx file to write")
    args = parser.parse_args()
    export(args.checkpoint, args.panoramas, args.out)


def export(checkpoint: Path, panoramas: Path, out: Path) -> None:
    """``panoramas`` are those of the training.

    Raises :class:`ArithmeticError` where ONNX and torch disagree.
    """
    net = OrientationNet()
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    if "features.0.0.bias" in state["average"]:
        net = folded(net)
    net.load_state_dict(state["average"])
    net.eval()
    rng = np.random.default_rng(0)
    picture = torch.tensor(rng.uniform(0, 255, (2, 3, CROP_SIZE[1], CROP_SIZE[0])).astype("f4"))
    single = out.with_suffix(".single.onnx")
    torch.onnx.export(
        net,
        (picture,),
        str(single),
        input_names=["picture"],
        output_names=["dense", "roll", "pose"],
        dynamic_axes={name: {0: "batch"} for name in ("picture", "dense", "roll", "pose")},
        opset_version=17,
        dynamo=False,
    )
    model = onnx.load(str(single))
    single.unlink()
    _shrink(model)
    helper.set_model_props(model, {"steps": str(state["step"])})
    attach(model, trained_tilts(read_panoramas(panoramas, "train")))
    onnx.checker.check_model(model)
    written = model.SerializeToString()
    session = onnxruntime.InferenceSession(written, providers=["CPUExecutionProvider"])
    with torch.no_grad():
        expected = [output.numpy() for output in net(picture)]
    for name, ours, theirs in zip(
        ("dense", "roll", "pose"), session.run(None, {"picture": picture.numpy()}), expected,
        strict=True,
    ):  # fmt: skip
        apart = float(np.abs(ours - theirs).max())
        print(f"{name}: differs from torch by at most {apart:.4f}")  # noqa: T201
        if apart > _TOLERANCE:
            raise ArithmeticError(f"{name}: ONNX and torch differ by {apart}")
    partial = out.with_suffix(".part")
    partial.write_bytes(written)
    partial.replace(out)
    print(f"{out}: {len(written) / 2**20:.1f} MB")  # noqa: T201


def _shrink(model: onnx.ModelProto) -> None:
    """Store large weights smaller, and restore them to single precision where they are used.

    Those of convolutions as halves; those of the linear layers, a quarter of all and the least
    sensitive, as bytes with a scale for each output.
    """
    graph, restored = model.graph, []
    for weight in list(graph.initializer):
        if weight.data_type != TensorProto.FLOAT or np.prod(weight.dims) < _LARGE:
            continue
        values, name = numpy_helper.to_array(weight), weight.name
        if values.ndim == 2:
            scale = np.abs(values).max(axis=1) / 127
            small = np.round(values / scale[:, None]).astype(np.int8)
            zero = np.zeros(len(scale), np.int8)
            graph.initializer.append(numpy_helper.from_array(scale, f"{name}.scale"))
            graph.initializer.append(numpy_helper.from_array(zero, f"{name}.zero"))
            parts = [f"{name}.small", f"{name}.scale", f"{name}.zero"]
            restored.append(helper.make_node("DequantizeLinear", parts, [name], axis=0))
        else:
            small = values.astype(np.float16)
            restored.append(
                helper.make_node("Cast", [f"{name}.small"], [name], to=TensorProto.FLOAT)
            )
        weight.CopyFrom(numpy_helper.from_array(small, f"{name}.small"))
    for node in reversed(restored):
        graph.node.insert(0, node)


if __name__ == "__main__":
    main()
