"""What the documents show runs, and what they name exists."""

import re
from pathlib import Path

import numpy as np
import pytest

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


def test_every_page_is_on_a_list_of_the_site():
    """``make docs`` refuses one that is on none, and is not part of these tests."""
    listed = set((ROOT / "docs" / "index.md").read_text().splitlines())
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - listed == {"index"}
