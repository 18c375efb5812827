"""Processor time of one pass of each network, by engine and threads: python -m benchmarks.engines

    [--passes 20]

ONNX Runtime in 32 bits, and OpenVINO in 32 and in 16 bits (bf16) where it is installed, each with
one and with two threads, on noise of the size that 4:3 pictures need.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable

import numpy as np
import onnxruntime as ort

from benchmarks.tables import Rows, machine, markdown
from scene4d.perception.detectors._darknet import onnx_of_darknet
from scene4d.perception.detectors.yolox import _of_size
from scene4d.perception.weights import weight_path

PEOPLE = 6
THREADS = (1, 2)


def networks() -> dict[str, tuple[bytes, tuple[int, ...]]]:
    """The content of each, and the shape of its input."""
    layers, weights = weight_path("yolov4-tiny-layers"), weight_path("yolov4-tiny")
    vehicles = onnx_of_darknet(layers.read_text(), weights.read_bytes(), (608, 608))
    people = _of_size(weight_path("yolox-tiny"), (416, 320))
    keypoints = weight_path("rtmpose-s").read_bytes()
    return {
        "YOLOX-tiny, 416 x 320": (people, (1, 3, 320, 416)),
        f"RTMPose-s, {PEOPLE} people": (keypoints, (PEOPLE, 3, 256, 192)),
        "YOLOv4-tiny, 608 x 608": (vehicles, (1, 3, 608, 608)),
    }


def onnx_runtime(content: bytes, threads: int) -> Callable[[np.ndarray], object]:
    options = ort.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = threads, 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = ort.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    return lambda given: session.run(None, {name: given})


def openvino(content: bytes, threads: int, bits: str) -> Callable[[np.ndarray], object]:
    core = importlib.import_module("openvino").Core()
    how = {"INFERENCE_PRECISION_HINT": bits, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
    request = core.compile_model(core.read_model(content, b""), "CPU", how).create_infer_request()
    return lambda given: request.infer({0: given}, share_inputs=True)


def milliseconds(work: Callable[[np.ndarray], object], given: np.ndarray, passes: int) -> float:
    work(given)
    begun = time.process_time()
    for _ in range(passes):
        work(given)
    return 1e3 * (time.process_time() - begun) / passes


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.engines", description=__doc__)
    parser.add_argument("--passes", type=int, default=20)
    passes = parser.parse_args().passes
    engines = {"ONNX Runtime": onnx_runtime}
    if importlib.util.find_spec("openvino"):
        engines["OpenVINO f32"] = lambda content, threads: openvino(content, threads, "f32")
        engines["OpenVINO bf16"] = lambda content, threads: openvino(content, threads, "bf16")
    heads = [f"{name}, {n} thread{'s' * (n > 1)}" for name in engines for n in THREADS]
    rows: Rows = [["network", *heads]]
    rng = np.random.default_rng(0)
    for name, (content, shape) in networks().items():
        given = rng.random(shape, dtype=np.float32)
        opened = (engine(content, n) for engine in engines.values() for n in THREADS)
        rows.append([name, *(f"{milliseconds(work, given, passes):.1f} ms" for work in opened)])
    print(f"{machine()}\n\n{markdown(rows)}")


if __name__ == "__main__":
    main()
