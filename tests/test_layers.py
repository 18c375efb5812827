"""The layers of pyproject.toml hold, and import-linter would notice if they did not."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(ROOT / "src", tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def lint_imports(checkout: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout / "src")},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_layers_hold(checkout):
    found = lint_imports(checkout)
    assert found.returncode == 0, found.stdout + found.stderr
    assert "1 kept, 0 broken" in found.stdout


@pytest.mark.parametrize(
    ("where", "line", "message"),
    [
        pytest.param(
            "core/geometry/rotation.py",
            "import scene4d.calibration",
            "scene4d.core.geometry.rotation -> scene4d.calibration",
            id="upward",
        ),
        pytest.param(
            "video/reader.py",
            "def f():\n    from scene4d.perception import weights",
            "scene4d.video.reader -> scene4d.perception",
            id="sideways, inside a function",
        ),
        pytest.param("stray.py", "", "stray", id="a module in no layer"),
    ],
)
def test_a_stray_import_is_noticed(checkout, where, line, message):
    with (checkout / "src/scene4d" / where).open("a") as file:
        file.write(f"\n\n{line}\n")
    found = lint_imports(checkout)
    assert found.returncode == 1
    assert message in found.stdout + found.stderr
