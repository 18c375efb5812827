"""Opening ONNX networks for inference on the processor, quietly and with few threads."""

import os
from pathlib import Path

# Newer wheels report to their maker as soon as they are imported: nothing leaves this machine.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime as ort

ort.disable_telemetry_events()  # the variable is not read by every build (Windows)

DEFAULT_THREADS = 2

_ERRORS_ONLY = 3


def open_session(path: Path, threads: int = DEFAULT_THREADS) -> ort.InferenceSession:
    """An inference session on the processor that uses at most ``threads`` threads.

    Waiting threads sleep instead of spinning, because detector, keypoint network and decoder take
    turns on the same cores.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
