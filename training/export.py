"""Write the trained network as ONNX and check it: ``python -m training.export CHECKPOINT``.

Weights are stored in half precision and computed in single: half the size for no measurable error.
"""

import argparse
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import TensorProto, helper, numpy_helper

from training.model import OrientationNet
from training.panoramas import CROP_SIZE

_HALVED_FROM = 1024
_TOLERANCE = 0.05


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="the .onnx file to write")
    args = parser.parse_args()
    export(args.checkpoint, args.out)


def export(checkpoint: Path, out: Path) -> None:
    """Raises :class:`ArithmeticError` where ONNX and torch disagree."""
    net = OrientationNet()
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
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
    _halve(model)
    helper.set_model_props(model, {"steps": str(state["step"])})
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


def _halve(model: onnx.ModelProto) -> None:
    """Store large weights as half precision, with a cast to single behind each."""
    graph, casts = model.graph, []
    for weight in graph.initializer:
        if weight.data_type != TensorProto.FLOAT or np.prod(weight.dims) < _HALVED_FROM:
            continue
        values = numpy_helper.to_array(weight).astype(np.float16)
        name = weight.name
        weight.CopyFrom(numpy_helper.from_array(values, f"{name}.half"))
        casts.append(helper.make_node("Cast", [f"{name}.half"], [name], to=TensorProto.FLOAT))
    for cast in reversed(casts):
        graph.node.insert(0, cast)


if __name__ == "__main__":
    main()
