"""The layers of pyproject.toml hold, and import-linter would notice if they did not."""

import ast
import os
import re
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


UPWARD = ("core/geometry/rotation.py", "import scene4d.calibration")
SIDEWAYS = ("video/reader.py", "def f():\n    from scene4d.perception import weights")


@pytest.mark.parametrize(
    ("planted", "messages"),
    [
        (
            [UPWARD, SIDEWAYS],
            [
                "scene4d.core.geometry.rotation -> scene4d.calibration",
                "scene4d.video.reader -> scene4d.perception",
            ],
        ),
        ([("stray.py", "")], ["stray"]),  # a module in no layer
    ],
)
def test_a_stray_import_is_noticed(checkout, planted, messages):
    for where, line in planted:
        with (checkout / "src/scene4d" / where).open("a") as file:
            file.write(f"\n\n{line}\n")
    found = lint_imports(checkout)
    assert found.returncode == 1
    for message in messages:
        assert message in found.stdout + found.stderr


def private_uses() -> list[str]:
    """Imports of a room's private modules by another room."""
    source = ROOT / "src" / "scene4d"
    found = []
    for path in sorted(source.rglob("*.py")):
        room = path.relative_to(source).parts[0]
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            for name in names:
                package, _, rest = name.partition(".")
                other, _, inside = rest.partition(".")
                if package == "scene4d" and other != room and re.search(r"(^|\.)_[a-z]", inside):
                    found.append(f"{path.relative_to(source)}: {name}")
    return found


def test_what_carries_an_underscore_stays_in_its_room():
    assert private_uses() == []


def test_a_private_import_would_be_noticed(checkout, monkeypatch):
    path = checkout / "src" / "scene4d" / "searching" / "stages.py"
    path.write_text("from scene4d.store._claims import Claim\n" + path.read_text())
    monkeypatch.setattr(f"{__name__}.ROOT", checkout)
    assert private_uses() == ["searching/stages.py: scene4d.store._claims.Claim"]
