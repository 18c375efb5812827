"""The environment is the one that pyproject.toml and constraints.txt describe."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib import metadata, util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEAVY = {"cv2", "av", "onnx", "onnxruntime", "supervision", "matplotlib", "scipy"}
TOOLS_OF_THE_ENVIRONMENT = {"setuptools", "wheel"}  # some Pythons put them into each new one


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def installed() -> dict[str, str]:
    return {normal(d.metadata["Name"]): d.version for d in metadata.distributions()}


def constraints() -> list[str]:
    return (ROOT / "constraints.txt").read_text().splitlines()


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def names_of(requirements: list[str]) -> set[str]:
    return {normal(re.match(r"[\w.-]+", line)[0]) for line in requirements}


def declared() -> set[str]:
    return names_of(project()["dependencies"])


def extras() -> set[str]:
    return {
        name for lines in project()["optional-dependencies"].values() for name in names_of(lines)
    }


def test_one_opencv_without_a_display_owns_cv2():
    import cv2

    assert set(distributions_by_package()["cv2"]) == {"opencv-python-headless"}
    assert (4, 10) <= tuple(map(int, cv2.__version__.split(".")[:2])) < (5, 0)


def test_no_torch():
    assert util.find_spec("torch") is None


def test_constraints_are_exact_sorted_and_name_no_address():
    lines = constraints()
    assert lines
    for line in lines:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*==[0-9]+[0-9a-z.]*", line), line
    names = [line.partition("==")[0] for line in lines]
    assert names == sorted(set(names))


def test_the_installed_versions_are_those_of_the_constraints():
    pinned = dict(line.split("==") for line in constraints())
    found = installed()
    for name in TOOLS_OF_THE_ENVIRONMENT | {"scene4d"}:
        found.pop(name, None)
    strays = {f"{n}=={v}" for n, v in found.items() if pinned.get(n) != v}
    assert not strays, "not in constraints.txt: remove .venv and run `make test`"


def test_every_third_party_import_is_declared_and_every_dependency_imported():
    imported = set()
    for path in (ROOT / "src").rglob("*.py"):
        for module in imported_modules(ast.parse(path.read_text(encoding="utf-8"))):
            if module.partition(".")[0] not in sys.stdlib_module_names | {"scene4d"}:
                imported |= owners(module)
    assert declared() <= imported <= declared() | extras()


def imported_modules(tree: ast.Module) -> set[str]:
    modules = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            modules.add(node.module)
    return modules


NOT_INSTALLED = {"rerun": "rerun-sdk"}
"""Packages of extras that are too large for the tests, where the names differ."""


@cache
def distributions_by_package() -> dict[str, list[str]]:
    return dict(metadata.packages_distributions())


def owners(module: str) -> set[str]:
    """The distributions that bring `module`; of a shared name space, only those with its part."""
    top = module.partition(".")[0]
    names = set(distributions_by_package().get(top, [NOT_INSTALLED.get(top, top)]))
    if len(names) > 1:
        part = module.replace(".", "/") + "/"
        names = {n for n in names if any(str(f).startswith(part) for f in metadata.files(n))}
    return {normal(name) for name in names}


@pytest.mark.parametrize(
    "code",
    [
        pytest.param("import scene4d", id="import scene4d"),
        pytest.param("import scene4d.cli", id="import scene4d.cli"),
        pytest.param("from scene4d.cli import main; main()", id="scene4d --help"),
    ],
)
def test_nothing_heavy_is_imported_before_a_command_runs(code):
    script = (
        "import atexit, sys\n"
        "sys.argv = ['scene4d', '--help']\n"
        "atexit.register(lambda: print('loaded:', *sys.modules))\n"
    )
    run = [sys.executable, "-c", script + code]
    out = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    loaded = set(out.rpartition("loaded:")[2].split())
    assert "scene4d" in loaded
    assert not loaded & HEAVY


SKIPS = """
import pytest
def test_skip(): pytest.skip("no data")
@pytest.fixture
def absent(): pytest.skip("no weights")
def test_setup(absent): pass
@pytest.mark.xfail
def test_expected_to_fail(): assert False
def test_pass(): pass
"""


@pytest.mark.parametrize(
    ("ci", "code", "outcome"),
    [
        ("", 0, {"1 passed", "3 skipped", "1 xfailed"}),
        ("true", 1, {"1 passed", "1 failed", "1 xfailed", "2 error"}),
    ],
)
def test_in_ci_a_skipped_test_is_a_failure(tmp_path, ci, code, outcome):
    (tmp_path / "conftest.py").write_text((ROOT / "tests/conftest.py").read_text())
    (tmp_path / "test_skips.py").write_text(SKIPS)
    (tmp_path / "test_module.py").write_text("import pytest\npytest.importorskip('no_such')\n")
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "--continue-on-collection-errors"],
        cwd=tmp_path,
        env=os.environ
        | {"CI": ci, "PYTEST_ADDOPTS": "", "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == code, found.stdout
    last = found.stdout.splitlines()[-1]
    assert set(re.findall(r"\d+ (?:passed|failed|skipped|xfailed|error)", last)) == outcome
