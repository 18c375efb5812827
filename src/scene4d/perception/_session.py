"""Opens ONNX networks for inference, on the device asked for, without log messages.

By default ONNX Runtime runs everything on the processor; where OpenVINO is installed and the
processor multiplies numbers of 16 bits (bf16), it runs the networks that bear it. In 32 bits the
two are equally fast.
"""

import hashlib
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from scene4d.core.errors import InputError, UnavailableError

# Newer wheels send telemetry as soon as they are imported: nothing may leave this machine.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime as ort

ort.disable_telemetry_events()  # not every build reads the variable

AUTO, _CPU, _OPENVINO = "auto", "cpu", "openvino:"
_CORES = os.cpu_count() or 1
_TURNS = threading.BoundedSemaphore(_CORES)
"""A pass takes one thread: with two, ONNX Runtime took 10 % and OpenVINO 40 % more processor time,
and other networks, other cameras and the decoder need cores too. More passes at once than cores
would only take memory."""
_ERRORS_ONLY = 3
_BF16 = "BF16"
_ELSEWHERE = "AzureExecutionProvider"
"""A provider of ONNX Runtime that sends pictures away."""


def open_session(network: Path | bytes, device: str = AUTO) -> ort.InferenceSession:
    """An inference session of ONNX Runtime, from a file or its content; the same one for all who
    have it open. Where ``device`` is one of OpenVINO's, on the processor.

    Raises as :func:`check_device`, and :class:`UnavailableError` if the device cannot be used.
    """
    check_device(device)
    where = _CPU if device == AUTO or device.startswith(_OPENVINO) else device
    return _shared(where, network, lambda content: _opened(content, where))


def open_coarse(network: Path | bytes, device: str = AUTO) -> "ort.InferenceSession | _Vino":
    """The same for a network that bears numbers of 16 bits, where they are faster."""
    check_device(device)
    where = _openvino_device(device)
    if where is None:
        return open_session(network, device)
    return _shared(where, network, lambda content: _Vino(content, where))


def engine(device: str = AUTO) -> str:
    """What runs the networks opened by :func:`open_coarse`: results differ a little."""
    where = _openvino_device(device)
    if where is not None:
        return "openvino bf16" if where == "CPU" and _has_bf16() else f"openvino {where}"
    return f"onnxruntime {_CPU if device == AUTO else device}"


def devices() -> tuple[str, ...]:
    """What ``device`` may be here: ``auto``, ONNX Runtime's providers, ``openvino:`` and one of its
    devices.
    """
    core = _core()
    vino = () if core is None else tuple(f"{_OPENVINO}{d.lower()}" for d in core.available_devices)
    return AUTO, *_providers(), *vino


def check_device(device: str) -> None:
    """Raise :class:`InputError` if there is no such device here."""
    if device not in devices():
        raise InputError(
            f"device: found {device!r}, expected one of those that are here: "
            f"{', '.join(devices())}; others come with other builds of onnxruntime "
            "(onnxruntime-gpu for cuda) or with openvino"
        )


def _providers() -> dict[str, str]:
    """ONNX Runtime's names of its providers, by ours."""
    there = sorted(set(ort.get_available_providers()) - {_ELSEWHERE}, key=lambda p: p[:3] != "CPU")
    return {name.removesuffix("ExecutionProvider").lower(): name for name in there}


def _opened(content: bytes, device: str) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    names = _providers()
    wanted = [names[device], *([] if device == _CPU else [names[_CPU]])]
    session = _Session(content, options, providers=wanted)
    if session.get_providers()[0] != wanted[0]:  # it fell back, and said so in its log alone
        raise UnavailableError(
            f"device {device!r}: ONNX Runtime knows it but cannot use it: is its driver installed?"
        )
    return session


class _Session(ort.InferenceSession):  # type: ignore[misc]
    def run(self, *given: Any, **more: Any) -> Any:
        with _TURNS:
            return super().run(*given, **more)


_open: WeakValueDictionary[tuple[str, str], Any] = WeakValueDictionary()
_opening = threading.Lock()

_TELEMETRY = "openvino_telemetry"


def _shared(where: str, network: Path | bytes, opened: Callable[[bytes], Any]) -> Any:
    content = network if isinstance(network, bytes) else network.read_bytes()
    key = where, hashlib.sha256(content).hexdigest()
    with _opening:
        found = _open.get(key)
        if found is None:
            found = _open[key] = opened(content)
        return found


@cache
def _core() -> Any | None:
    """OpenVINO, where it is installed.

    As it is imported it sends a message to its makers, from a process that the end of the program
    waits for. Without its telemetry module, which None in its place means, it sends nothing.
    """
    before = sys.modules.setdefault(_TELEMETRY, None)  # type: ignore[arg-type]
    try:
        return import_module("openvino").Core()
    except ImportError:
        return None
    finally:
        if before is None:
            sys.modules.pop(_TELEMETRY, None)


def _has_bf16() -> bool:
    core = _core()
    return core is not None and _BF16 in core.get_property("CPU", "OPTIMIZATION_CAPABILITIES")


def _openvino_device(device: str) -> str | None:
    """OpenVINO's name of the device that runs coarse networks; None: ONNX Runtime runs them."""
    if device.startswith(_OPENVINO):
        return device.removeprefix(_OPENVINO).upper()
    return "CPU" if device == AUTO and _has_bf16() else None


class _Vino:
    """A network run by OpenVINO, in 16 bits where the device has them; used as ONNX Runtime's
    sessions are.
    """

    def __init__(self, content: bytes, device: str) -> None:
        core, how = _core(), {}
        assert core is not None
        if device == "CPU":
            precision = "bf16" if _has_bf16() else "f32"
            how = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": _CORES}
            how["NUM_STREAMS"] = _CORES  # each pass has one thread
        self._compiled = core.compile_model(core.read_model(content, b""), device, how)
        self._outputs = [output.any_name for output in self._compiled.outputs]
        self._idle: list[Any] = []  # requests: each keeps its input and its results

    def run(self, names: Sequence[str] | None, given: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """The outputs called ``names`` (None: all)."""
        with _TURNS:
            request = self._idle.pop() if self._idle else self._compiled.create_infer_request()
            request.infer(dict(given), share_inputs=True)
            wanted = self._outputs if names is None else names
            found = [np.array(request.get_tensor(name).data) for name in wanted]
            self._idle.append(request)
        return found
