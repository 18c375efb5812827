"""Opens ONNX networks for inference on the CPU, without log messages and with few threads."""

import os
from pathlib import Path

# Newer wheels send telemetry as soon as they are imported: nothing may leave this machine.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime as ort

ort.disable_telemetry_events()  # not every build reads the variable

THREADS = 2
"""Threads per network, chosen by hand: the decoder and other networks need cores too."""
_ERRORS_ONLY = 3


def open_session(network: Path | bytes) -> ort.InferenceSession:
    """An inference session on the CPU, from a file or its content.

    Waiting threads sleep instead of spinning, because detector, keypoint network and decoder take
    turns on the same cores.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = THREADS
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    source = network if isinstance(network, bytes) else str(network)
    return ort.InferenceSession(source, options, providers=["CPUExecutionProvider"])
