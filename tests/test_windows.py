"""What Windows lacks is not needed. Simulated: files that are open elsewhere can still be replaced
here, which they cannot be there.
"""

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
WITHOUT = """
import os, sys, warnings
from pathlib import Path
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty"):
    sys.modules[name] = None
warnings.filterwarnings("ignore", module="filelock")
opened = os.open
def no_folders(path, *rest, **options):
    if isinstance(path, (str, os.PathLike)) and os.path.isdir(path):
        raise PermissionError(13, "Permission denied", str(path))
    return opened(path, *rest, **options)
os.open = no_folders

import importlib, pkgutil, scene4d
for one in pkgutil.walk_packages(scene4d.__path__, "scene4d."):
    if not one.name.endswith("__main__"):
        importlib.import_module(one.name)

from stored_scenes import store, walk, writer
from scene4d.store.query import Scene
folder = Path(sys.argv[1])
store(folder, walk(90))
with writer(folder, run="q") as one:
    one.write(walk(60, seed=1))
assert len(Scene.open(folder)) == 150
"""


def test_a_scene_is_written_and_read_without_fcntl_and_without_opening_folders(tmp_path):
    words = [sys.executable, "-W", "ignore", "-c", WITHOUT, str(tmp_path / "scene")]
    done = subprocess.run(words, cwd=HERE / "store", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
