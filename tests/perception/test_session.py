import gc
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from scene4d.core.errors import InputError, UnavailableError
from scene4d.perception import _session
from scene4d.perception.weights import engine_name


@pytest.fixture
def doubling():
    """A network that doubles what it is given."""
    here, out = (helper.make_tensor_value_info(n, TensorProto.FLOAT, ["n"]) for n in "xy")
    graph = helper.make_graph([helper.make_node("Add", ["x", "x"], ["y"])], "g", [here], [out])
    opset = [helper.make_opsetid("", 17)]
    return onnx.helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString()


class FakeOpenVino:
    """What scene4d asks of OpenVINO; a network of it adds one."""

    available_devices = ("CPU", "GPU")

    def __init__(self, capabilities):
        self.capabilities = capabilities
        self.asked = {}
        self.requests = 0

    def Core(self):
        return self

    def get_property(self, device, name):
        assert (device, name) == ("CPU", "OPTIMIZATION_CAPABILITIES")
        return self.capabilities

    def read_model(self, model, weights):
        assert isinstance(model, bytes) and weights == b""
        return model

    def compile_model(self, model, device, how):
        self.device, self.asked = device, how
        outputs = [SimpleNamespace(any_name="y")]
        return SimpleNamespace(outputs=outputs, create_infer_request=self.request)

    def request(self):
        self.requests += 1
        tensors = {}

        def infer(given, share_inputs):
            tensors["y"] = SimpleNamespace(data=given["x"] + 1)

        return SimpleNamespace(infer=infer, get_tensor=tensors.__getitem__)


@pytest.fixture
def installed(monkeypatch):
    def install(made):
        def importing(name):
            if made is None:
                raise ImportError(name)
            return made

        monkeypatch.setattr(_session, "import_module", importing)
        _session._core.cache_clear()

    yield install
    _session._core.cache_clear()


@pytest.mark.parametrize("made", [None, FakeOpenVino(["FP32", "INT8"])])
def test_onnx_runtime_runs_all_where_nothing_is_faster(doubling, installed, made):
    installed(made)
    session = _session.open_coarse(doubling)
    assert engine_name() == "onnxruntime cpu"
    assert session.run(None, {"x": np.float32([1, 2])})[0].tolist() == [2, 4]


def test_who_opens_a_network_again_shares_it_until_nobody_has_it(doubling, tmp_path):
    (tmp_path / "doubling.onnx").write_bytes(doubling)
    first = _session.open_session(doubling)
    assert _session.open_session(tmp_path / "doubling.onnx") is first
    before = weakref.ref(first)
    del first
    gc.collect()
    assert before() is None


def test_openvino_runs_what_bears_16_bits_where_the_processor_has_them(doubling, installed):
    made = FakeOpenVino(["FP32", "BF16"])
    installed(made)
    assert engine_name() == "openvino bf16"
    session = _session.open_coarse(doubling)
    for names in (None, ["y"]):
        assert session.run(names, {"x": np.float32([1, 2])})[0].tolist() == [2, 3]
    assert made.asked["INFERENCE_PRECISION_HINT"] == "bf16"
    assert made.device == "CPU" and made.requests == 1
    assert made.asked["INFERENCE_NUM_THREADS"] == made.asked["NUM_STREAMS"]
    exact = _session.open_session(doubling)
    assert exact.run(None, {"x": np.float32([1, 2])})[0].tolist() == [2, 4]


def test_a_device_that_is_here_is_taken_and_one_that_is_not_is_told_with_those_that_are(
    doubling, installed
):
    made = FakeOpenVino(["FP32", "BF16"])
    installed(made)
    assert {"auto", "cpu", "openvino:cpu", "openvino:gpu"} <= set(_session.devices())
    assert not any("azure" in device for device in _session.devices())
    assert engine_name("cpu") == "onnxruntime cpu"
    exact = _session.open_coarse(doubling, "cpu")
    assert exact.run(None, {"x": np.float32([1])})[0].tolist() == [2]
    assert engine_name("openvino:gpu") == "openvino GPU"
    there = _session.open_coarse(doubling, "openvino:gpu")
    assert there.run(None, {"x": np.float32([1])})[0].tolist() == [2] and made.device == "GPU"
    assert "INFERENCE_PRECISION_HINT" not in made.asked  # as the device likes it
    for refused in (engine_name, lambda device: _session.open_session(doubling, device)):
        with pytest.raises(InputError, match=r"device: found 'npu', .*auto, cpu.*openvino:gpu"):
            refused("npu")
    installed(None)
    with pytest.raises(InputError, match="openvino:cpu"):
        _session.open_coarse(doubling, "openvino:cpu")


@pytest.mark.filterwarnings("ignore:Specified provider")
def test_a_device_that_onnx_runtime_knows_but_cannot_use_is_no_silent_fallback(
    doubling, installed, monkeypatch
):
    installed(None)
    known = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(_session.ort, "get_available_providers", lambda: known)
    assert _session.devices() == ("auto", "cpu", "cuda")
    with pytest.raises(UnavailableError, match=r"device 'cuda'.*cannot use it"):
        _session.open_session(doubling, "cuda")


def test_several_threads_run_one_network_of_openvino_at_once(doubling, installed):
    made = FakeOpenVino(["BF16"])
    installed(made)
    session = _session.open_coarse(doubling)
    given = [np.float32([k]) for k in range(40)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda x: session.run(None, {"x": x})[0][0], given))
    assert found == list(range(1, 41))
    assert 1 <= made.requests <= _session._CORES


def test_openvino_is_imported_without_the_module_that_tells_its_makers(tmp_path, monkeypatch):
    (tmp_path / "openvino_telemetry.py").write_text("told = True\n")
    (tmp_path / "openvino.py").write_text(
        "try:\n    import openvino_telemetry\n    TELLS = True\n"
        "except ImportError:\n    TELLS = False\n"
        "class Core:\n    tells = TELLS\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("openvino", "openvino_telemetry"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    assert _session._core.__wrapped__().tells is False
    assert "openvino_telemetry" not in sys.modules  # whoever wants it can have it
    del sys.modules["openvino"]
