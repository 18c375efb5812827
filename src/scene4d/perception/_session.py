"""Opens ONNX networks for inference on the CPU, without log messages and with few threads.

ONNX Runtime runs everything; where OpenVINO is installed and the processor multiplies numbers of 16
bits (bf16), it runs the networks that bear it. In 32 bits the two are equally fast.
"""

import hashlib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

# Newer wheels send telemetry as soon as they are imported: nothing may leave this machine.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime as ort

ort.disable_telemetry_events()  # not every build reads the variable

THREADS = 2
"""Threads per network, chosen by hand: the decoder and other networks need cores too."""
_TURNS = threading.BoundedSemaphore(max(1, (os.cpu_count() or 1) // THREADS))
"""Several cameras of one process take turns: more at once are no faster, and each takes memory."""
_ERRORS_ONLY = 3
_BF16 = "BF16"


def open_session(network: Path | bytes) -> ort.InferenceSession:
    """An inference session on the CPU, from a file or its content; the same one for all who have
    it open.

    Waiting threads sleep instead of spinning, because detector, keypoint network and decoder take
    turns on the same cores.
    """
    return _shared("onnxruntime", network, lambda: _opened(network))


def _opened(network: Path | bytes) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = THREADS
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    source = network if isinstance(network, bytes) else str(network)
    return _Session(source, options, providers=["CPUExecutionProvider"])


class _Session(ort.InferenceSession):  # type: ignore[misc]
    def run(self, *given: Any, **more: Any) -> Any:
        with _TURNS:
            return super().run(*given, **more)


_open: WeakValueDictionary[tuple[str, str], Any] = WeakValueDictionary()
_opening = threading.Lock()


def _shared(engine: str, network: Path | bytes, opened: Callable[[], Any]) -> Any:
    content = network if isinstance(network, bytes) else network.read_bytes()
    key = engine, hashlib.sha256(content).hexdigest()
    with _opening:
        found = _open.get(key)
        if found is None:
            found = _open[key] = opened()
        return found


def open_coarse(network: Path | bytes) -> "ort.InferenceSession | _HalfSession":
    """The same for a network that bears numbers of 16 bits, where they are faster."""
    core = _half_core()
    if core is None:
        return open_session(network)
    return _shared("openvino", network, lambda: _HalfSession(core, network))


def engine() -> str:
    """What runs the networks opened by :func:`open_coarse`: results differ a little."""
    return "onnxruntime" if _half_core() is None else "openvino bf16"


@cache
def _half_core() -> Any | None:
    """OpenVINO, where it is installed and the processor multiplies numbers of 16 bits."""
    try:
        core = import_module("openvino").Core()
    except ImportError:
        return None
    return core if _BF16 in core.get_property("CPU", "OPTIMIZATION_CAPABILITIES") else None


class _HalfSession:
    """A network run by OpenVINO in 16 bits; used as ONNX Runtime's sessions are."""

    def __init__(self, core: Any, network: Path | bytes) -> None:
        content = network if isinstance(network, bytes) else network.read_bytes()
        how = {
            "INFERENCE_PRECISION_HINT": "bf16",
            "INFERENCE_NUM_THREADS": THREADS,
            "NUM_STREAMS": 1,
        }
        compiled = core.compile_model(core.read_model(content, b""), "CPU", how)
        self._outputs = [output.any_name for output in compiled.outputs]
        self._request = compiled.create_infer_request()
        self._lock = threading.Lock()  # a request keeps its input and its results

    def run(self, names: Sequence[str] | None, given: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """The outputs called ``names`` (None: all)."""
        with self._lock:
            self._request.infer(dict(given), share_inputs=True)
            wanted = self._outputs if names is None else names
            return [np.array(self._request.get_tensor(name).data) for name in wanted]
