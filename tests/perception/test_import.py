import subprocess
import sys


def test_importing_the_layer_loads_nothing_heavy():
    code = (
        "import sys, scene4d.perception, scene4d.perception.detectors, scene4d.perception.weights;"
        "print([m for m in ('cv2', 'onnxruntime', 'supervision', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
