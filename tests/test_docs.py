"""What the documents show runs, and what they name exists."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import scene4d
from scene4d.calibration.calibrating import run_detections
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.writing import write
from scene4d.core.progress import Silent
from scene4d.formats.demo import demo_detections

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted((ROOT / "docs").glob("*.md"))


def test_the_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("ok ")


def test_the_tutorial_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """On the embedded people of the sample video, so that no network is needed."""
    people = demo_detections()
    result = run_detections(people, CalibrateOptions(), Silent(), "the sample video")
    write(result, tmp_path / "first", progress=Silent())
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "tutorial.md").read_text()
    scope: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, "tutorial.md", "exec"), scope)
    out = capsys.readouterr().out
    assert "metres from the camera" in out and "error within the scene" in out
    assert 0.3 < np.median(scope["speeds"]) < 2.0
    assert 1.2 < max(scope["speeds"]) < 4.0


def test_the_example_on_points_finds_its_camera(capsys: pytest.CaptureFixture[str]):
    runpy.run_path(str(ROOT / "examples" / "points_to_camera.py"), run_name="__main__")
    out = capsys.readouterr().out
    focal = float(re.search(r"focal length +([\d.]+)", out)[1])
    assert focal == pytest.approx(900, rel=0.1)


def test_the_python_of_the_other_pages_runs(tmp_path, monkeypatch):
    """Searching has its own test, which has a scene."""
    monkeypatch.chdir(tmp_path)
    camera = scene4d.Camera.from_pose(
        image_size=(64, 48), focal_px=90.0, tilt_rad=0.3, roll_rad=0.0, height_m=5.0
    )
    K, distortion, R, t = camera.K, camera.distortion, camera.R, camera.t
    given = {"width": 64, "height": 48, "K": K, "distortion": distortion, "R": R, "t": t}
    for page in ("accuracy.md", "predicates.md"):
        for block in python_of(ROOT / "docs" / page):
            exec(compile(block, page, "exec"), dict(given))
    assert scene4d.Camera.load("surveyed.json").K[0, 0] == pytest.approx(90.0)


def test_there_are_no_other_examples():
    """``py`` marks what needs a camera or footage; scripts/wheel.py runs that of the README."""
    tested = {"README", "tutorial", "accuracy", "predicates", "searching", "sites"}
    assert {page.stem for page in PAGES if python_of(page)} == tested
    for page in PAGES:
        for block in re.findall(r"```py\n(.*?)```", page.read_text(), re.DOTALL):
            compile(block, page.name, "exec")


def python_of(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)


def test_every_page_is_on_the_site_once():
    lists = re.findall(r"```{toctree}\n(.*?)```", (ROOT / "docs/index.md").read_text(), re.DOTALL)
    named = [line for one in lists for line in one.splitlines() if line and line[0] != ":"]
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"}
    assert sorted(named) == sorted(pages)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_files_named_in_the_pages_exist(page: Path):
    text = page.read_text()
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), target
    for script in re.findall(r"python ((?:benchmarks|docs|examples)/\S+\.py)", text):
        assert (ROOT / script).exists(), script


def test_the_accuracy_table_is_there():
    for page, least in ((ROOT / "README.md", 7), (ROOT / "docs" / "accuracy.md", 10)):
        _, rest = page.read_text().split("<!-- accuracy: begin -->")
        table, _ = rest.split("<!-- accuracy: end -->")
        assert "PETS 2009 video | nothing |" in table
        assert len(table.strip().splitlines()) >= least
