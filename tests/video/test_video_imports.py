"""The package itself stays light; only its modules load the decoders."""

import subprocess
import sys


def test_importing_the_package_loads_neither_av_nor_opencv():
    code = "import sys, scene4d.video; print(sorted({'av', 'cv2', 'numpy'} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
