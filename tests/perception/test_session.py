import gc
import weakref
from types import SimpleNamespace

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

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

    def __init__(self, capabilities):
        self.capabilities = capabilities
        self.asked = {}

    def Core(self):
        return self

    def get_property(self, device, name):
        assert (device, name) == ("CPU", "OPTIMIZATION_CAPABILITIES")
        return self.capabilities

    def read_model(self, model, weights):
        assert isinstance(model, bytes) and weights == b""
        return model

    def compile_model(self, model, device, how):
        self.asked = how
        request = SimpleNamespace(infer=self.infer, get_tensor=lambda name: self.tensors[name])
        outputs = [SimpleNamespace(any_name="y")]
        return SimpleNamespace(outputs=outputs, create_infer_request=lambda: request)

    def infer(self, given, share_inputs):
        self.tensors = {"y": SimpleNamespace(data=given["x"] + 1)}


@pytest.fixture
def installed(monkeypatch):
    def install(made):
        def importing(name):
            if made is None:
                raise ImportError(name)
            return made

        monkeypatch.setattr(_session, "import_module", importing)
        _session._half_core.cache_clear()

    yield install
    _session._half_core.cache_clear()


@pytest.mark.parametrize("made", [None, FakeOpenVino(["FP32", "INT8"])])
def test_onnx_runtime_runs_all_where_nothing_is_faster(doubling, installed, made):
    installed(made)
    session = _session.open_coarse(doubling)
    assert engine_name() == "onnxruntime"
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
    assert made.asked["INFERENCE_NUM_THREADS"] == _session.THREADS
    exact = _session.open_session(doubling)
    assert exact.run(None, {"x": np.float32([1, 2])})[0].tolist() == [2, 4]
